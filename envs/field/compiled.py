"""Compiled code on disk: none that is older than what it was made of."""

from __future__ import annotations

import contextlib
from pathlib import Path


def forget_older(file: str, *sources: str) -> None:
    """Delete what Numba keeps of the module `file` if one of `sources`, which it is made of too, is newer.

    Numba looks at the module alone: after a change of what it imports, the old code would go on to run.
    """
    path = Path(file)
    with contextlib.suppress(OSError):  # of a process beside this one, or no files at all
        newest = max(Path(source).stat().st_mtime_ns for source in sources)
        for index in path.with_name("__pycache__").glob(f"{path.stem}.*.nbi"):
            if index.stat().st_mtime_ns < newest:
                index.unlink()
