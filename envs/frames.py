"""Frames kept in memory and on disk, keyed by everything that they depend on.

One file per (phantom, array, imaging, simulator): its name is a hash of all four, where "simulator" means the
sources that compute a frame, the versions of the libraries under them and the processor; an image's content
is part of its phantom. `cache/frame_files.py` writes it atomically and checks it; what does not fit is
simulated again, never served.
"""

from __future__ import annotations

import contextlib
import hashlib
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from usbench.envs.bmode import Imaging
from usbench.envs.cache import frame_files
from usbench.envs.cache.folder import mark_used, not_kept
from usbench.envs.cache.sources import code_hash, hash_of, is_own, sources
from usbench.envs.pose import Pose
from usbench.envs.probe import DEFAULT_ARRAY, LinearArray
from usbench.envs.scanner import scan, scan_batch
from usbench.envs.settings import as_row, from_row, table_of
from usbench.envs.tissue import Tissue
from usbench.words import in_words

Frame = npt.NDArray[np.uint8]
Progress = Callable[[int, int], None]
GRID = ("height_px", "width_px", "pixel_size")  # what of the imaging a slice of a recorded image has
_BATCH = 12  # frames that are made side by side, and told of together


def _simulator() -> str:
    """Return a hash of the code and the libraries that compute a frame, and of the processor."""
    return code_hash("scanner")


def _anatomy() -> str:
    """Return a hash of the code that turns an image into tissue, or into frames."""
    return hash_of(sorted(sources("anatomy.simulated", "anatomy.recorded").items()))


# Taken when the code is: sources that change later are not what this process runs.
SIMULATOR, ANATOMY = _simulator(), _anatomy()


class FrameStore:
    """Frames of one phantom, array and imaging by pose: simulated once, then looked up.

    Attributes:
        scene: Phantom, array and imaging.
        path: The file on disk.
    """

    def __init__(self, phantom: Tissue, array: LinearArray, imaging: Imaging) -> None:
        """Nothing is read or simulated yet."""
        self.scene = (phantom.shown, array, imaging)
        self._frames: dict[Pose, Frame] = {}
        self._loaded = False
        key = hash_of((*self.scene, SIMULATOR, ANATOMY))
        # The code of a stranger's class is in no hash: its frames are not kept on disk.
        self._is_kept = is_own((phantom, array, imaging))
        self.path = frame_files.FRAMES.path(key)

    def frame(self, pose: Pose) -> Frame:
        """Return the frame from `pose`, (height_px, width_px) uint8, read-only."""
        if not self.has(pose):
            make([(self, pose)])
        return self._frames[pose]

    def has(self, pose: Pose) -> bool:
        """Return whether the frame from `pose` is in memory or on disk."""
        if pose not in self._frames:
            self._load()
        return pose in self._frames

    def prepare(self, poses: Iterable[Pose], progress: Progress | None = None) -> None:
        """Simulate what is missing of `poses` and keep it on disk; `progress(done, total)` of each.

        What was simulated before an interruption is kept, too.
        """
        self._load()
        missing = [pose for pose in dict.fromkeys(poses) if pose not in self._frames]
        done = 0
        try:
            for batch in _batches(missing):
                make([(self, pose) for pose in batch])
                for _ in batch:
                    done += 1
                    if progress is not None:
                        progress(done, len(missing))
        finally:
            if done:  # also before an interruption
                self._save()

    def digest(self, poses: Iterable[Pose]) -> str:
        """Return a hash of the bytes of the frames from `poses`, in their order."""
        digest = hashlib.sha256()
        for pose in poses:
            digest.update(self.frame(pose).tobytes())
        return digest.hexdigest()

    def keep(self, pose: Pose, frame: Frame) -> Frame:
        """Keep a frame in memory, and return the one that is kept for `pose`."""
        frame.flags.writeable = False
        return self._frames.setdefault(pose, frame)

    def _load(self) -> None:
        if self._loaded or not self._is_kept:
            return
        self._loaded = True
        try:
            self._read()
        except (FileNotFoundError, NotADirectoryError):
            return
        except Exception as error:  # a damaged archive raises nearly anything
            warnings.warn(
                f"frames are simulated again, as {self.path} cannot be used: {error}.", stacklevel=3
            )

    def _read(self) -> None:
        contents = frame_files.read(self.path)
        mark_used(self.path)
        for pose, frame in zip(contents.poses.tolist(), contents.frames, strict=True):
            self.keep(from_row(pose), frame)

    def _save(self) -> None:
        if not self._is_kept:
            return
        if (_simulator(), _anatomy()) != (SIMULATOR, ANATOMY):
            warnings.warn(
                "frames are not kept on disk: the simulator's sources have changed since they were imported.",
                stacklevel=3,
            )
            return
        with contextlib.suppress(Exception):  # `_load` has told of a damaged file
            self._read()  # what other processes have added meanwhile
        known = dict(self._frames)  # to which other threads may add
        poses = np.array([as_row(pose) for pose in known], dtype=np.int32)
        frames = np.stack(list(known.values()))
        scene = " ".join(map(in_words, self.scene))
        try:
            frame_files.write(self.path, frame_files.Contents(scene, SIMULATOR, poses, frames))
        except OSError as error:
            warnings.warn(not_kept("frames", error), stacklevel=3)


def _batches(poses: Sequence[Pose]) -> Iterator[Sequence[Pose]]:
    """Yield poses that are made side by side, those with the same table of responses one after the other."""
    for table in sorted({table_of(pose) for pose in poses}):
        alike = [pose for pose in poses if table_of(pose) == table]
        for start in range(0, len(alike), _BATCH):
            yield alike[start : start + _BATCH]


def make(wanted: Iterable[tuple[FrameStore, Pose]]) -> None:
    """Make the frames that stores do not have yet, all of one array and imaging at once, on all cores."""
    missing = list(dict.fromkeys((store, pose) for store, pose in wanted if not store.has(pose)))
    for array, imaging in dict.fromkeys(store.scene[1:] for store, _ in missing):
        alike = [(store, pose) for store, pose in missing if store.scene[1:] == (array, imaging)]
        scenes = [(store.scene[0], pose) for store, pose in alike]
        for (store, pose), frame in zip(alike, _frames(scenes, array, imaging), strict=True):
            store.keep(pose, frame)


def _frames(scenes: Sequence[tuple[Tissue, Pose]], array: LinearArray, imaging: Imaging) -> list[Frame]:
    """Return a frame per tissue and pose: of the recorded image where there is one, or simulated."""
    shape = imaging.height_px, imaging.width_px
    recorded = [tissue.recorded_frame(pose, shape, imaging.pixel_size) for tissue, pose in scenes]
    missing = [scene for scene, frame in zip(scenes, recorded, strict=True) if frame is None]
    simulated = iter(
        [scan(*missing[0], array, imaging)] if len(missing) == 1 else scan_batch(missing, array, imaging)
    )
    return [next(simulated) if frame is None else frame for frame in recorded]


def check_recorded(array: LinearArray, imaging: Imaging, usual: Imaging) -> None:
    """Raise ValueError where a recorded image is to have what its slices do not follow from.

    They follow neither from the probe nor from anything of `imaging` but the size and number of its pixels:
    the rest has to be as `usual`.
    """
    if array != DEFAULT_ARRAY:
        raise ValueError("a recorded image keeps the probe of its recording: leave the probe out.")
    for name, value in asdict(imaging).items():
        if name not in GRID and value != getattr(usual, name):
            raise ValueError(
                f"a recorded image is shown as it was recorded: leave {name} at {getattr(usual, name)}, "
                f"not {value}; of the imaging {', '.join(GRID)} can be chosen."
            )


def frame_store(phantom: Tissue, array: LinearArray, imaging: Imaging) -> FrameStore:
    """Return the store of this scene that the whole process shares."""
    return _stores(phantom, array, imaging)


def keep_stores(n_stores: int) -> None:
    """Let this process keep the stores of `n_stores` scenes, with all frames that were looked at.

    Eight are kept anyway. An agent that meets the same phantoms again needs none of their frames twice.
    """
    global _stores
    if n_stores > _stores.cache_parameters()["maxsize"]:
        _stores = lru_cache(maxsize=n_stores)(FrameStore)


_stores = lru_cache(maxsize=8)(FrameStore)
