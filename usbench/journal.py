"""Files of JSON lines that only grow: a crash can tear nothing but the last line, which is passed over."""

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Self


class Journal:
    """A file of JSON lines that only grows; each call adds whole lines and flushes them."""

    def __init__(self, path: Path) -> None:
        """Open `path` for appending."""
        self._file = path.open("a", encoding="utf-8")

    def append(self, rows: Iterable[Mapping[str, Any]]) -> None:
        """Add one line per row.

        Raises:
            ValueError: If a row holds a number that is not finite.
        """
        self._file.write("".join(json.dumps(row, allow_nan=False) + "\n" for row in rows))
        self._file.flush()

    def __enter__(self) -> Self:
        """Return the open journal."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the file."""
        self._file.close()


def read_rows(path: Path) -> list[dict[str, Any]]:
    """Read a journal; a last line that a crash left unfinished is passed over.

    Raises:
        ValueError: If any other line is broken.
    """
    rows: list[dict[str, Any]] = []
    if not path.exists():
        return rows
    lines = path.read_bytes().split(b"\n")
    for number, line in enumerate(lines, start=1):
        # A whole line ends with a newline, so what stands after the last one is torn or empty.
        if number == len(lines):
            break
        try:
            row = json.loads(line)
            if not isinstance(row, dict):
                raise ValueError("not an object")
        except ValueError as error:
            raise ValueError(f"{path}, line {number}, is not a record: {error}.") from error
        rows.append(row)
    return rows
