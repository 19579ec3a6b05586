"""Files of scatterers: how many they hold, and their columns; .csv with a header line, or .npz."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from usbench.checks import unknown
from usbench.envs.arrays import real

SUFFIXES = (".csv", ".npz")
# What the columns are called in m, and in mm.
NAMES = ("x", "y", "z", "amplitude")
NAMES_MM = ("x_mm", "y_mm", "z_mm", "amplitude")
_HEAD = 1 << 16
# What reading a damaged archive raises, or one that is encrypted or packed in an unknown way (RuntimeError).
_DAMAGED = (zipfile.BadZipFile, EOFError, KeyError, RuntimeError, TypeError, zlib.error)


def count(path: Path) -> int:
    """Return how many scatterers a file holds, of a .csv file an estimate, without reading it as a whole.

    Raises:
        OSError: If the file cannot be read.
        ValueError: If it is neither .csv nor .npz, damaged, or has not the columns.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise ValueError(str(unknown("suffix", path.suffix, SUFFIXES)))
    if path.suffix.lower() == ".npz":
        return _count_npz(path)
    with path.open("rb") as file:
        head = file.read(_HEAD)
    lines = head.count(b"\n") + 1
    return round(path.stat().st_size / max(len(head), 1) * lines)


def read(path: Path) -> npt.NDArray[np.float64]:
    """Return x, y, z in m and the amplitude of every scatterer, (n, 4).

    Raises:
        OSError: If the file cannot be read.
        ValueError: If a column is missing or there twice, a value is not a finite number, or there is no row.
    """
    columns = _npz(path) if path.suffix.lower() == ".npz" else _csv(path)
    values = np.stack([columns[name] for name in columns], axis=1)
    if not len(values):
        raise ValueError("it has no scatterer.")
    bad = np.argwhere(~np.isfinite(values))
    if len(bad):
        row, column = bad[0]
        raise ValueError(f"{[*columns][column]} of scatterer {row + 1} must be a finite number.")
    if "x_mm" in columns:
        values[:, :3] *= 1e-3
    return values


def _chosen(names: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the four columns, or raise ValueError if one is missing or there twice."""
    wanted = NAMES_MM if set(NAMES_MM[:3]) & set(names) else NAMES
    missing = [name for name in wanted if name not in names]
    if missing:
        found = ", ".join(names) or "none"
        raise ValueError(
            f"its columns must be {', '.join(NAMES)} (positions in m) or {', '.join(NAMES_MM)}, "
            f"not {found}: missing {', '.join(missing)}."
        )
    for name in wanted:
        if (count := names.count(name)) > 1:
            raise ValueError(f"{name} must be one of its columns, not {count} of them.")
    return wanted


def _csv(path: Path) -> dict[str, npt.NDArray[np.float64]]:
    import pandas as pd  # takes half a second

    try:
        table = pd.read_csv(path, comment="#", skipinitialspace=True)
        # Its first line alone: in the table, the second of two names that are alike is another one.
        head = pd.read_csv(path, comment="#", skipinitialspace=True, header=None, nrows=1, na_filter=False)
    except pd.errors.EmptyDataError:
        raise ValueError("it is empty.") from None
    except (pd.errors.ParserError, UnicodeDecodeError) as error:
        raise ValueError(f"it is no table of numbers ({' '.join(str(error).split())}).") from error
    if not isinstance(table.index, pd.RangeIndex):  # what pandas makes of values without a name
        raise ValueError(f"its lines have more values than its header has names ({len(table.columns)}).")
    table.columns = [str(name).strip() for name in table.columns]
    if pd.to_numeric(table.columns, errors="coerce").notna().all():
        raise ValueError(f"its first line must name the columns ({', '.join(NAMES)}), not hold numbers.")
    chosen = _chosen([name for cell in head.iloc[0] if (name := str(cell).strip())])
    return {name: pd.to_numeric(table[name], errors="coerce").to_numpy(np.float64) for name in chosen}


def _npz(path: Path) -> dict[str, npt.NDArray[np.float64]]:
    try:
        with np.load(path, allow_pickle=False) as arrays:
            found = {name: real(name, arrays[name]) for name in _chosen(arrays.files)}
    except _DAMAGED as error:
        raise ValueError(f"it is no file of arrays ({error}).") from error
    shapes = {array.shape for array in found.values()}
    if len(shapes) > 1 or len(next(iter(shapes))) != 1:
        raise ValueError(f"its arrays must have one shape (n,), not {', '.join(map(str, sorted(shapes)))}.")
    return found


def _count_npz(path: Path) -> int:
    """Return the length of the array of amplitudes from its header alone."""
    try:
        with zipfile.ZipFile(path) as archive:
            _chosen([name.removesuffix(".npy") for name in archive.namelist()])
            with archive.open("amplitude.npy") as file:
                version = np.lib.format.read_magic(file)
                header = {
                    (1, 0): np.lib.format.read_array_header_1_0,
                    (2, 0): np.lib.format.read_array_header_2_0,
                }[version]
                shape: tuple[int, ...] = header(file)[0]
    except _DAMAGED as error:
        raise ValueError(f"it is no file of arrays ({error}).") from error
    return int(np.prod(shape))
