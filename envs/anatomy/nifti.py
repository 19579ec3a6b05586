"""What ITK does not tell of a NIfTI file: a missing spacing, voxels that are cut off or not finite."""

from __future__ import annotations

import gzip
import struct
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

ENDINGS = (".nii", ".nii.gz")
# NIfTI 1 and 2, by the size of the header: where pixdim[1:4], datatype and vox_offset are, and their types.
_PLACES = {348: ((80, "3f"), (70, "h"), (108, "f")), 540: ((112, "3d"), (12, "h"), (168, "q"))}
# Types of single values that ITK reads, by their code.
_TYPES = {
    2: "u1", 4: "i2", 8: "i4", 16: "f4", 64: "f8", 256: "i1", 512: "u2", 768: "u4", 1024: "i8", 1280: "u8",
}  # fmt: skip


@dataclass(frozen=True)
class Header:
    """Spacing along i, j, k as it is written, type of a voxel, and the byte where the voxels begin."""

    spacing: tuple[float, ...]
    voxel: np.dtype[Any]
    offset: int


def read_header(path: Path) -> Header:
    """Return the header of a NIfTI file.

    Raises:
        ValueError: If it is none, is damaged, or is not compressed as its name says.
    """
    head = _read(path, 0, max(_PLACES))
    for size, places in _PLACES.items():
        for order in "<>":
            if len(head) >= size and struct.unpack_from(f"{order}i", head)[0] == size:
                spacing, (code,), (offset,) = (
                    struct.unpack_from(order + kind, head, place) for place, kind in places
                )
                # Also of what is no number; ITK holds it in 32 bits.
                if not abs(offset) < 2**31:
                    raise _damaged(path)
                return Header(spacing, np.dtype(order + _TYPES[code]), max(int(offset), size))
    raise ValueError(f"{str(path)!r} is not a readable NIfTI file.")


def read_voxels(path: Path, count: int) -> npt.NDArray[Any]:
    """Return the first `count` voxels as they are stored, (count,).

    Raises:
        ValueError: If some are missing, or the file is damaged.
    """
    header = read_header(path)
    n_bytes = count * header.voxel.itemsize
    # One byte more, so that gzip comes to its checksum.
    content = _read(path, header.offset, n_bytes + 1)
    if len(content) < n_bytes:
        raise _damaged(path)
    return np.frombuffer(content, header.voxel, count)


def _read(path: Path, begin: int, n_bytes: int) -> bytes:
    """Return bytes of the decompressed file, fewer where it ends."""
    with path.open("rb") as file:
        if not path.name.lower().endswith(".gz"):
            file.seek(begin)
            return file.read(n_bytes)
        if file.read(2) != b"\x1f\x8b":
            raise ValueError(f"{str(path)!r} is not compressed by gzip: a plain NIfTI must be named .nii.")
        file.seek(0)
        try:
            with gzip.open(file) as decompressed:
                decompressed.seek(begin)
                return decompressed.read(n_bytes)
        except (EOFError, gzip.BadGzipFile, zlib.error) as error:
            raise _damaged(path) from error


def _damaged(path: Path) -> ValueError:
    return ValueError(f"{str(path)!r} cannot be read: the file is damaged.")
