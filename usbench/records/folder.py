"""The folder of a trial: made, found again, and its state written and read.

A trial folder holds `trial.json` (resolved configuration, versions, hash of the frames, status, anchors),
`episodes.jsonl` (one line per training episode), `evaluations.jsonl` (one line per evaluation episode),
`model.zip` and TensorBoard events; while it runs, `checkpoints` too.
"""

import json
import re
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from usbench.atomic import atomic_file
from usbench.records import checksums, schema
from usbench.records.configuration import ConfigurationError, TrialConfig

SCHEMA = 1
STATUSES = ("running", "interrupted", "failed", "finished")
TRIAL, EPISODES, EVALUATIONS, MODEL = "trial.json", "episodes.jsonl", "evaluations.jsonl", "model.zip"
TENSORBOARD, CHECKPOINTS = "tensorboard", "checkpoints"
_EARLIER = re.compile(r"\.earlier-\d+$")


def create(out: Path, config: TrialConfig) -> Path:
    """Make an empty trial folder and return its path; an earlier one with episodes is kept beside it.

    Raises:
        ConfigurationError: If the folder cannot be made or written.
    """
    folder = out / config.folder_name
    try:
        out.mkdir(parents=True, exist_ok=True)
        if folder.exists() and not _is_empty(folder):
            number = 1
            while (earlier := folder.with_name(f"{folder.name}.earlier-{number}")).exists():
                number += 1
            folder.rename(earlier)
        folder.mkdir(exist_ok=True)
        with atomic_file(folder / TRIAL) as file:
            file.write(b"{}\n")
    except OSError as error:
        raise unwritable(out, error) from error
    return folder


def unwritable(out: Path, error: OSError) -> ConfigurationError:
    """Return the error for an output folder that cannot be written."""
    return ConfigurationError(
        f"the output folder {str(out)!r} cannot be written ({error.strerror}): choose another with --out."
    )


def _is_empty(folder: Path) -> bool:
    """Return whether a trial ended in `folder` before its first episode; what it left is removed then."""
    sizes = {path.name: path.stat().st_size for path in folder.iterdir()}
    made = {TRIAL, EPISODES, EVALUATIONS, MODEL, TENSORBOARD, CHECKPOINTS}
    if not sizes.keys() <= made or sizes.get(EPISODES):
        return False
    for name in sizes:
        path = folder / name
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    return True


def write_state(folder: Path, state: Mapping[str, Any]) -> None:
    """Write `trial.json`.

    Raises:
        ValueError: If the status is not one of STATUSES.
    """
    if state["status"] not in STATUSES:
        raise ValueError(f"status must be one of {', '.join(STATUSES)}, not {state['status']!r}.")
    content = json.loads(json.dumps({"schema": SCHEMA, **state}, default=str))
    content[checksums.KEY] = checksums.of_state(content)
    with atomic_file(folder / TRIAL) as file:
        file.write(json.dumps(content, indent=2, sort_keys=True).encode() + b"\n")


def read_state(folder: Path) -> dict[str, Any]:
    """Read `trial.json`; an empty dictionary if there is none.

    Raises:
        ValueError: If the file is not the JSON that `write_state` writes, or was changed since.
    """
    path = folder / TRIAL
    try:
        state = json.loads(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, NotADirectoryError):
        return {}
    except ValueError as error:
        raise ValueError(f"{path} is not a trial record: {error}.") from error
    if not isinstance(state, dict):
        raise ValueError(f"{path} is not a trial record: it holds {type(state).__name__}, not an object.")
    if state.get("schema", SCHEMA) != SCHEMA:
        raise ValueError(f"{path} has schema {state['schema']!r}; this version reads schema {SCHEMA}.")
    # Trials of earlier versions have none.
    if state.pop(checksums.KEY, None) not in (None, checksums.of_state(state)):
        raise checksums.damaged(path)
    schema.check(path, state)
    return state


def trial_folders(runs: Path) -> list[Path]:
    """Return the trial folders in `runs`, which may be one itself; earlier attempts are left out."""
    candidates = (
        [runs] if (runs / TRIAL).exists() else sorted(path.parent for path in runs.glob(f"*/{TRIAL}"))
    )
    return [folder for folder in candidates if not _EARLIER.search(folder.name)]
