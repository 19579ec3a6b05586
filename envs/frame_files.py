"""Files of frames on disk: written atomically, checked when read, limited in size, listed and cleared.

What a file holds is told by its name, a hash that `frames.py` makes; how frames come about is not known here.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import platformdirs

from usbench.atomic import LEFT_BEHIND_S, atomic_file, remove_leftovers

MAX_BYTES = 250_000_000
# Of files that a killed process began to write.
_LEFTOVERS = ".frames-*.part"


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


@dataclass(frozen=True)
class Entry:
    """A file of the folder; `contents` is None if it is damaged, `used` the time of its last use (s)."""

    path: Path
    size: int
    used: float
    contents: Contents | None


def cache_folder() -> Path:
    """Return where frames are kept: USBENCH_CACHE, or the platform's folder for caches."""
    chosen = os.environ.get("USBENCH_CACHE")
    return Path(chosen).expanduser() if chosen else platformdirs.user_cache_path("usbench")


def frames_path(key: str) -> Path:
    """Return the file of the frames whose key is the hash `key`."""
    return cache_folder() / f"frames-{key[:32]}.npz"


def read(path: Path) -> Contents:
    """Return what the file at `path` holds; anything may be raised if it is not as it was written."""
    # Opened here: of a damaged archive, NumPy would leave it open.
    with path.open("rb") as raw, np.load(raw, allow_pickle=False) as file:
        contents = Contents(str(file["scene"]), str(file["simulator"]), file["poses"], file["frames"])
        if str(file["checksum"]) != _checksum(path.name, contents):
            raise ValueError("its checksum is wrong")
    return contents


def mark_used(path: Path) -> None:
    """Let the file at `path` be dropped last."""
    with contextlib.suppress(OSError):  # a folder that can only be read serves as well
        os.utime(path)


def write(path: Path, contents: Contents) -> None:
    """Write `contents` to `path`, all or nothing, and keep the folder small.

    Raises:
        OSError: If the folder cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_file(path) as file:
        np.savez(file, **vars(contents), checksum=_checksum(path.name, contents))
    _prune(path)


def entries() -> list[Entry]:
    """Return the files of frames, the one used last first."""
    found = []
    for used, size, path in _files(cache_folder(), "frames-*.npz"):
        contents = None
        with contextlib.suppress(Exception):  # a damaged archive raises nearly anything
            contents = read(path)
        found.append(Entry(path, size, used, contents))
    return found


def clear() -> tuple[int, int]:
    """Remove all files of frames; return how many there were, and their bytes."""
    folder = cache_folder()
    files = _files(folder, "frames-*.npz")
    for _, _, path in files:
        path.unlink(missing_ok=True)
    remove_leftovers(folder, _LEFTOVERS, LEFT_BEHIND_S)
    return len(files), sum(size for _, size, _ in files)


def _checksum(name: str, contents: Contents) -> str:
    """Return a hash of what a file holds, shapes included, and of its name: a renamed file is foreign."""
    poses, frames = contents.poses, contents.frames
    shapes = (poses.shape, poses.dtype.str, frames.shape, frames.dtype.str)
    header = repr((name, contents.scene, contents.simulator, shapes)).encode()
    return hashlib.sha256(header + poses.tobytes() + frames.tobytes()).hexdigest()


def _files(folder: Path, pattern: str) -> list[tuple[float, int, Path]]:
    """Return time of last use, size and path of the files that match, the one used last first."""
    found = []
    for path in folder.glob(pattern):
        with contextlib.suppress(FileNotFoundError):  # another process has removed it
            status = path.stat()
            found.append((status.st_mtime, status.st_size, path))
    return sorted(found, reverse=True)


def _prune(kept: Path) -> None:
    """Drop what killed processes left, and the files used longest ago above MAX_BYTES; `kept` stays."""
    remove_leftovers(kept.parent, _LEFTOVERS, LEFT_BEHIND_S)
    total = 0
    for _, size, path in _files(kept.parent, "frames-*.npz"):
        total += size
        if total > MAX_BYTES and path != kept:
            with contextlib.suppress(OSError):  # where files that are read cannot be removed
                path.unlink()
