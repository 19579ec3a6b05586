"""Files of JSON lines that only grow: a crash can tear nothing but the last line, which is passed over."""

import hashlib
import json
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Self

Mark = dict[str, int | str]
# What reading JSON raises of a file that is damaged, or made to be: lists in lists without end, or too large.
UNREADABLE = (ValueError, RecursionError, MemoryError)


class Journal:
    """A file of JSON lines that only grows; each call adds whole lines and flushes them."""

    def __init__(self, path: Path) -> None:
        """Open `path` for appending."""
        self._path = path
        self._file = path.open("ab")
        self._begin(path.read_bytes())

    def append(self, rows: Iterable[Mapping[str, Any]]) -> None:
        """Add one line per row.

        Raises:
            ValueError: If a row holds a number that is not finite.
        """
        lines = "".join(json.dumps(row, allow_nan=False) + "\n" for row in rows).encode()
        self._file.write(lines)
        self._file.flush()
        self._size += len(lines)
        self._digest.update(lines)

    def mark(self) -> Mark:
        """Return what stands here, as length and checksum, once it is safe on the disk."""
        os.fsync(self._file.fileno())
        return {"bytes": self._size, "sha256": self._digest.hexdigest()}

    def cut(self, mark: Mark) -> None:
        """Take away what was added after `mark`.

        Raises:
            ValueError: If what stands before it is not what stood there.
        """
        kept = kept_at(self._path, mark)
        self._file.truncate(len(kept))
        self._begin(kept)

    def _begin(self, content: bytes) -> None:
        self._size, self._digest = len(content), hashlib.sha256(content)

    def __enter__(self) -> Self:
        """Return the open journal."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the file."""
        self.close()

    def close(self) -> None:
        """Close the file, whole on the disk."""
        with self._file:
            os.fsync(self._file.fileno())


def append_all(path: Path, rows: Iterable[Mapping[str, Any]]) -> None:
    """Add rows to the journal at `path`, which may be new: all of them or, where the disk is full, none.

    Raises:
        OSError: If they cannot be written.
    """
    before = path.stat().st_size if path.is_file() else 0
    try:
        with Journal(path) as journal:
            journal.append(rows)
    except OSError:
        if path.is_file():
            os.truncate(path, before)
        raise


def kept_at(path: Path, mark: Mark) -> bytes:
    """Return what stood in the journal at `mark`.

    Raises:
        ValueError: If it does not stand there any more.
    """
    content = path.read_bytes()[: int(mark["bytes"])] if path.exists() else b""
    if hashlib.sha256(content).hexdigest() != mark["sha256"]:
        raise ValueError(f"{path} is not what its trial wrote: its first {mark['bytes']} bytes differ.")
    return content


def cut_torn_line(path: Path) -> None:
    """Take away a last line that a crash left unfinished, so that others can follow."""
    if path.is_file():
        content = path.read_bytes()
        with path.open("r+b") as file:
            file.truncate(content.rfind(b"\n") + 1)


def read_rows(path: Path) -> list[dict[str, Any]]:
    """Read a journal; a last line that a crash left unfinished is passed over.

    Raises:
        ValueError: If any other line is broken, or the file does not fit into the memory.
    """
    rows: list[dict[str, Any]] = []
    if not path.exists():
        return rows
    try:
        lines = path.read_bytes().split(b"\n")
    except MemoryError as error:
        raise ValueError(f"{path} is not a record: {told(error)}.") from error
    for number, line in enumerate(lines, start=1):
        # A whole line ends with a newline, so what stands after the last one is torn or empty.
        if number == len(lines):
            break
        try:
            row = json.loads(line)
            if not isinstance(row, dict):
                raise ValueError("not an object")
        except UNREADABLE as error:
            raise ValueError(f"{path}, line {number}, is not a record: {told(error)}.") from error
        rows.append(row)
    return rows


def told(error: BaseException) -> str:
    """Return what an error of `UNREADABLE` says; one of the memory says nothing by itself."""
    return str(error) or "it does not fit into the memory"
