"""Tables of `field/` on disk: written atomically, checked, limited in size, and mapped rather than read.

A file is a structured array of NumPy with one element, in which every array of a table is a field. So NumPy
alone opens it, without unpickling anything, and processes that use the same table share its pages.
"""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from usbench.atomic import atomic_file
from usbench.envs.cache.folder import Entry, Kind, mark_used, not_kept
from usbench.envs.cache.sources import code_hash, hash_of, is_own

MAX_BYTES = 1_000_000_000
TABLES = Kind("table", ".npy")
_ALIGNMENT = 64  # bytes: arrays begin at whole lines of the processor's cache, as vectors need

_Table = TypeVar("_Table")


def _code() -> str:
    """Return a hash of the code and the libraries that make tables, and of the processor."""
    return code_hash("field.response_table")


# Taken when the code is: sources that change later are not what this process runs.
CODE = _code()


@dataclass(frozen=True)
class Contents:
    """What a file holds.

    Attributes:
        scene: What the table was made of, in words, for people.
        code: Hash of what made it.
        arrays: By name.
    """

    scene: str
    code: str
    arrays: dict[str, npt.NDArray[Any]]


def on_disk(array: object, table: Callable[..., _Table], scene: str, make: Callable[[], _Table]) -> _Table:
    """Return the table that was made of the same `scene` before and is on disk, or make it and keep it.

    Args:
        array: The transducer; of a class that is not of this package no table is kept.
        table: A dataclass of arrays and plain numbers.
        scene: What the table is and what it follows from, all of it, in words.
        make: Makes it.
    """
    if not is_own(array):
        return make()
    path = TABLES.path(hash_of((scene, CODE)))
    names = [field.name for field in fields(table)]  # type: ignore[arg-type]
    try:
        arrays = read(path).arrays
        mark_used(path)
        return table(**{name: arrays[name] if arrays[name].ndim else arrays[name].item() for name in names})
    except (FileNotFoundError, NotADirectoryError):
        pass
    except Exception as error:  # a damaged file raises nearly anything
        warnings.warn(f"a table is made again, as {path} cannot be used: {error}.", stacklevel=2)
    made = make()
    _keep(path, Contents(scene, CODE, {name: np.asarray(getattr(made, name)) for name in names}))
    return made


def read(path: Path) -> Contents:
    """Return what the file at `path` holds, mapped; anything may be raised if it is not as it was written."""
    # Copied where it is written to: compiled code is that for arrays that were made here, the file stays.
    row = np.lib.format.open_memmap(path, mode="c")
    names = row.dtype.names or ()
    if row.shape != (1,) or not {"scene", "code", "checksum"} < set(names):
        raise ValueError("it is no table")
    arrays = {name: np.asarray(row[name][0]) for name in names}
    scene, code, checksum = (arrays.pop(name).item().decode() for name in ("scene", "code", "checksum"))
    contents = Contents(scene, code, arrays)
    if checksum != _checksum(path.name, contents):
        raise ValueError("its checksum is wrong")
    return contents


def write(path: Path, contents: Contents) -> None:
    """Write `contents` to `path`, all or nothing, and keep the folder small.

    Raises:
        OSError: If the folder cannot be written.
    """
    words = {"scene": contents.scene, "code": contents.code, "checksum": _checksum(path.name, contents)}
    values = contents.arrays | {name: np.array(text.encode()) for name, text in words.items()}
    sizes = [-(-value.nbytes // _ALIGNMENT) * _ALIGNMENT for value in values.values()]
    row = np.zeros(
        1,
        dtype=np.dtype(
            {
                "names": list(values),
                "formats": [(value.dtype, value.shape) for value in values.values()],
                "offsets": [sum(sizes[:k]) for k in range(len(sizes))],
                "itemsize": sum(sizes),
            }
        ),
    )
    for name, value in values.items():
        row[name] = value
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_file(path) as file:
        np.save(file, row, allow_pickle=False)
    TABLES.prune(path, MAX_BYTES)


def entries() -> list[Entry[Contents]]:
    """Return the files of tables, the one used last first."""
    return TABLES.entries(read)


def _keep(path: Path, contents: Contents) -> None:
    """Write a table, or tell why not."""
    if sum(array.nbytes for array in contents.arrays.values()) > MAX_BYTES:
        return  # it would push out all others
    if _code() != CODE:
        why = "tables are not kept on disk: the simulator's sources have changed since they were imported."
    else:
        try:
            return write(path, contents)
        except OSError as error:
            why = not_kept("tables", error)
    warnings.warn(why, stacklevel=3)


def _checksum(name: str, contents: Contents) -> str:
    """Return a hash of what a file holds, shapes included, and of its name: a renamed file is foreign."""
    shapes = [(key, array.shape, array.dtype.str) for key, array in contents.arrays.items()]
    digest = hashlib.sha256(repr((name, contents.scene, contents.code, shapes)).encode())
    for array in contents.arrays.values():
        digest.update(np.ascontiguousarray(array).data)
    return digest.hexdigest()
