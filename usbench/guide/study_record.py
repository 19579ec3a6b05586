"""What a study has begun with: other options are refused, without PyTorch, before an address is told."""

import json
from pathlib import Path
from typing import Any

from usbench.records import ConfigurationError
from usbench.records.journal import UNREADABLE
from usbench.results.studies import STUDY, damaged, folder_of


def agent_of(runs: Path, name: str) -> str | None:
    """Return who advises in the study `name` in a folder of `runs`; None if it has not begun."""
    try:
        record = json.loads((folder_of(runs, name) / STUDY).read_text(encoding="utf-8"))
        return str(record["agent"])
    except (*UNREADABLE, OSError, KeyError, TypeError):  # what is wrong with it is told where it goes on
        return None


def has_begun(runs: Path, name: str, record: dict[str, Any]) -> bool:
    """Return whether the study `name` in a folder of `runs` has begun.

    Args:
        runs: Folder with trials and studies.
        name: Of the study.
        record: What its record has to hold; nothing else of it is compared.

    Raises:
        ConfigurationError: If the study has begun otherwise, or its record is damaged.
    """
    path = folder_of(runs, name) / STUDY
    if not path.is_file():
        return False
    now = json.loads(json.dumps(record))
    try:
        # Studies of earlier versions do not tell how much is played.
        before = {"plays": now.get("plays"), **json.loads(path.read_text(encoding="utf-8"))}
    except (*UNREADABLE, TypeError) as error:
        raise damaged(path, error) from error
    if differing := [key for key in now if before.get(key) != now[key]]:
        raise ConfigurationError(
            f"the study {name!r} has begun with another {_said(differing[0], before, now)}: "
            "give the same options as before, or choose another name."
        )
    return True


def _said(key: str, before: dict[str, Any], now: dict[str, Any]) -> str:
    """Return in words what is another: with both values where they are short."""
    short = isinstance(now[key], str | float | int)
    return f"{key} ({before.get(key)}, not {now[key]})" if short else key
