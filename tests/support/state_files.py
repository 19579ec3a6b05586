"""`trial.json` as plain data, so that tests may write what no trial would."""

import json

from usbench import records
from usbench.records import checksums


def read_state(folder):
    """What stands in `trial.json`, without its schema and checksum; empty if there is none."""
    path = folder / records.TRIAL
    state = json.loads(path.read_text()) if path.exists() else {}
    return {key: value for key, value in state.items() if key not in ("schema", checksums.KEY)}


def write_state(folder, state):
    """Write `trial.json` with a checksum that is right, whatever `state` holds."""
    content = json.loads(json.dumps({"schema": 1, **state}, default=str))
    content[checksums.KEY] = checksums.of_state(content)
    (folder / records.TRIAL).write_text(json.dumps(content))
