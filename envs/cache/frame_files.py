"""Files of frames on disk: written atomically, checked when read, limited in size, listed and cleared.

What a file holds is told by its name, a hash that `frames.py` makes; how frames come about is not known here.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from usbench.atomic import atomic_file
from usbench.envs.cache.folder import Entry, Kind

MAX_BYTES = 250_000_000
FRAMES = Kind("frames", ".npz")


@dataclass(frozen=True)
class Contents:
    """What a file holds.

    Attributes:
        scene: Phantom, array and imaging in words, for people.
        simulator: Hash of what computed the frames.
        poses: Of every frame the coordinates of the table, settings 0 where the array's and the imaging's own
            are meant, (n_frames, n_coordinates).
        frames: (n_frames, height_px, width_px).
    """

    scene: str
    simulator: str
    poses: npt.NDArray[np.int32]
    frames: npt.NDArray[np.uint8]


def read(path: Path) -> Contents:
    """Return what the file at `path` holds; anything may be raised if it is not as it was written."""
    # Opened here: of a damaged archive, NumPy would leave it open.
    with path.open("rb") as raw, np.load(raw, allow_pickle=False) as file:
        contents = Contents(str(file["scene"]), str(file["simulator"]), file["poses"], file["frames"])
        if str(file["checksum"]) != _checksum(path.name, contents):
            raise ValueError("its checksum is wrong")
    return contents


def write(path: Path, contents: Contents) -> None:
    """Write `contents` to `path`, all or nothing, and keep the folder small.

    Raises:
        OSError: If the folder cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_file(path) as file:
        np.savez(file, **vars(contents), checksum=_checksum(path.name, contents))
    FRAMES.prune(path, MAX_BYTES)


def entries() -> list[Entry[Contents]]:
    """Return the files of frames, the one used last first."""
    return FRAMES.entries(read)


def _checksum(name: str, contents: Contents) -> str:
    """Return a hash of what a file holds, shapes included, and of its name: a renamed file is foreign."""
    poses, frames = contents.poses, contents.frames
    shapes = (poses.shape, poses.dtype.str, frames.shape, frames.dtype.str)
    header = repr((name, contents.scene, contents.simulator, shapes)).encode()
    return hashlib.sha256(header + poses.tobytes() + frames.tobytes()).hexdigest()
