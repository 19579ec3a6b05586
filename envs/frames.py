"""Frames kept in memory and on disk, keyed by everything that they depend on.

One file per (phantom, array, imaging, simulator): its name is a hash of all four, where "simulator" means the
sources that compute a frame, the versions of the libraries under them and the processor; an image's content
is part of its phantom. `frame_files.py` writes it atomically and checks it; what does not fit is simulated
again, never served.
"""

from __future__ import annotations

import ast
import contextlib
import hashlib
import platform
import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import fields, is_dataclass
from functools import lru_cache
from importlib import metadata
from pathlib import Path
from typing import Any

import llvmlite.binding
import numpy as np
import numpy.typing as npt

from usbench.envs import frame_files
from usbench.envs.bmode import Imaging
from usbench.envs.pose import Pose
from usbench.envs.probe import LinearArray
from usbench.envs.scanner import scan, scan_batch
from usbench.envs.settings import as_row, from_row, table_of
from usbench.envs.tissue import Tissue

Frame = npt.NDArray[np.uint8]
Progress = Callable[[int, int], None]
_BATCH = 12  # frames that are made side by side, and told of together

_LIBRARIES = ("numpy", "scipy", "numba", "llvmlite", "opencv-python-headless")


def sources(*first: str) -> dict[str, bytes]:
    """Return the source by name of every module that computes a frame: the `first`, and what they import."""
    found: dict[str, bytes] = {}
    waiting = list(first)
    while waiting:
        name = waiting.pop()
        if name in found:
            continue
        found[name] = _file(name).read_bytes()
        for node in ast.walk(ast.parse(found[name])):
            modules = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom):
                modules = [f"{node.module}.{alias.name}" for alias in node.names]
            waiting += [own for module in modules if (own := _own_module(module))]
    return found


def _own_module(imported: str) -> str:
    """Return the module below usbench.envs that an import names, or takes a name from; "" if none."""
    name = imported.removeprefix("usbench.envs.")
    if name == imported:
        return ""
    return name if _file(name).exists() else name.rpartition(".")[0]


def _file(name: str) -> Path:
    return Path(__file__).parent.joinpath(*name.split(".")).with_suffix(".py")


def _simulator() -> str:
    """Return a hash of the code and the libraries that compute a frame, and of the processor."""
    versions = [f"{name} {metadata.version(name)}" for name in _LIBRARIES]
    processor = (platform.machine(), llvmlite.binding.get_host_cpu_name())
    return _hash((sorted(sources("scanner").items()), versions, processor))


def _anatomy() -> str:
    """Return a hash of the code that turns an image into tissue, or into frames."""
    return _hash(sorted(sources("anatomy.simulated", "anatomy.recorded").items()))


def _hash(value: object) -> str:
    return hashlib.sha256(repr(value).encode()).hexdigest()


# Taken when the code is: sources that change later are not what this process runs.
SIMULATOR, ANATOMY = _simulator(), _anatomy()


class FrameStore:
    """Frames of one phantom, array and imaging by pose: simulated once, then looked up."""

    def __init__(self, phantom: Tissue, array: LinearArray, imaging: Imaging) -> None:
        """Nothing is read or simulated yet."""
        self._scene = (phantom.shown, array, imaging)
        self._frames: dict[Pose, Frame] = {}
        self._loaded = False
        key = _hash((*self._scene, SIMULATOR, ANATOMY))
        # The code of a stranger's tissue is in no hash: its frames are not kept on disk.
        self._is_kept = type(phantom).__module__.startswith("usbench.envs.")
        self.path = frame_files.frames_path(key)

    def frame(self, pose: Pose) -> Frame:
        """Return the frame from `pose`, (height_px, width_px) uint8, read-only."""
        frame = self._frames.get(pose)
        if frame is None:
            self._load()
            frame = self._frames.get(pose)
        if frame is None:
            frame = self._keep(pose, self._scan([pose])[0])
        return frame

    def prepare(self, poses: Iterable[Pose], progress: Progress | None = None) -> None:
        """Simulate what is missing of `poses` and keep it on disk; `progress(done, total)` after each."""
        self._load()
        missing = [pose for pose in dict.fromkeys(poses) if pose not in self._frames]
        done = 0
        for table in sorted({table_of(pose) for pose in missing}):
            alike = [pose for pose in missing if table_of(pose) == table]
            for start in range(0, len(alike), _BATCH):
                batch = alike[start : start + _BATCH]
                for pose, frame in zip(batch, self._scan(batch), strict=True):
                    self._keep(pose, frame)
                    done += 1
                    if progress is not None:
                        progress(done, len(missing))
        if missing:
            self._save()

    def digest(self, poses: Iterable[Pose]) -> str:
        """Return a hash of the bytes of the frames from `poses`, in their order."""
        digest = hashlib.sha256()
        for pose in poses:
            digest.update(self.frame(pose).tobytes())
        return digest.hexdigest()

    def _scan(self, poses: Sequence[Pose]) -> Sequence[Frame]:
        phantom, array, imaging = self._scene
        shape = imaging.height_px, imaging.width_px
        recorded = [phantom.recorded_frame(pose, shape, imaging.pixel_size) for pose in poses]
        found = [frame for frame in recorded if frame is not None]
        if found:
            return found
        if len(poses) == 1:
            return [scan(phantom, poses[0], array, imaging)]
        return list(scan_batch([(phantom, pose) for pose in poses], array, imaging))

    def _keep(self, pose: Pose, frame: Frame) -> Frame:
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
        frame_files.mark_used(self.path)
        for pose, frame in zip(contents.poses.tolist(), contents.frames, strict=True):
            self._keep(from_row(pose), frame)

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
        poses = np.array([as_row(pose) for pose in self._frames], dtype=np.int32)
        frames = np.stack(list(self._frames.values()))
        scene = " ".join(map(_in_words, self._scene))
        try:
            frame_files.write(self.path, frame_files.Contents(scene, SIMULATOR, poses, frames))
        except OSError as error:
            warnings.warn(f"frames are not kept on disk: {error}.", stacklevel=3)


@lru_cache(maxsize=8)
def frame_store(phantom: Tissue, array: LinearArray, imaging: Imaging) -> FrameStore:
    """Return the store of this scene that the whole process shares."""
    return FrameStore(phantom, array, imaging)


def _in_words(value: Any) -> str:
    """Return a dataclass with those fields alone that differ from their defaults."""
    if not is_dataclass(value):
        return repr(value)
    changed = [field.name for field in fields(value) if getattr(value, field.name) != field.default]
    settings = ", ".join(f"{name}={_in_words(getattr(value, name))}" for name in changed)
    return f"{type(value).__name__}({settings})"
