"""Checksums of records, so that what was damaged after a trial is not taken for what it wrote."""

import hashlib
import importlib
import inspect
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

# Where `trial.json` keeps the checksum of everything else in it.
KEY = "checksum"
MEND = "bring it back, or remove the folder {} to run the trial again."


def of(folder: Path, names: Iterable[str]) -> dict[str, str]:
    """Return the SHA-256 of the files `names` in `folder`."""
    return {name: _of_file(folder / name) for name in names}


def of_state(state: Mapping[str, Any]) -> str:
    """Return the SHA-256 of what stands in `trial.json`, as JSON gives it back, whatever its layout."""
    return hashlib.sha256(json.dumps(state, sort_keys=True).encode()).hexdigest()


def of_modules(names: Iterable[str]) -> str:
    """Return a checksum of the files of modules, empty where one has none: who works on them starts anew."""
    try:
        found = [_of_file(Path(inspect.getfile(importlib.import_module(name)))) for name in names]
    except (OSError, TypeError):
        return ""
    return found[0] if len(found) == 1 else hashlib.sha256("".join(found).encode()).hexdigest()


def _of_file(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def check(folder: Path, expected: Mapping[str, str]) -> None:
    """Check that the files in `folder` are those of which `of` gave `expected`.

    Raises:
        ValueError: If one is not.
    """
    for name, checksum in expected.items():
        if not (folder / name).exists():
            raise ValueError(f"{folder / name} is missing: {MEND.format(folder.name)}")
        if of(folder, [name])[name] != checksum:
            raise damaged(folder / name)


def damaged(path: Path) -> ValueError:
    """Return the error for a file of a trial that is not what the trial wrote."""
    return ValueError(f"{path} is damaged, it is not what its trial wrote: {MEND.format(path.parent.name)}")
