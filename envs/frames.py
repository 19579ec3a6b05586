"""Frames kept in memory and on disk, keyed by everything that they depend on.

One file per (phantom, array, imaging, simulator): its name is a hash of all four, where "simulator" means the
bytes of the modules that compute a frame, the versions of the libraries under them and the processor. It is
written atomically and carries a checksum; what does not fit is simulated again, never served.
"""

from __future__ import annotations

import hashlib
import os
import platform
import tempfile
import warnings
from collections.abc import Callable, Iterable
from functools import lru_cache
from importlib import metadata
from pathlib import Path

import llvmlite.binding
import numpy as np
import numpy.typing as npt
import platformdirs

from usbench.envs.bmode import Imaging
from usbench.envs.phantom import Phantom
from usbench.envs.pose import Pose
from usbench.envs.probe import LinearArray
from usbench.envs.scanner import scan

Frame = npt.NDArray[np.uint8]
Progress = Callable[[int, int], None]

MAX_CACHE_BYTES = 256 * 2**20
_MODULES = (
    "pose", "phantom", "probe", "aperture", "elevation", "vector", "response", "summation", "rf", "bmode",
    "scanner",
)  # fmt: skip
_LIBRARIES = ("numpy", "scipy", "numba", "opencv-python-headless")


def cache_folder() -> Path:
    """Return where frames are kept: USBENCH_CACHE, or the platform's folder for caches."""
    return Path(os.environ.get("USBENCH_CACHE") or platformdirs.user_cache_path("usbench"))


@lru_cache(maxsize=1)
def _simulator() -> str:
    """Return a hash of the code and the libraries that compute a frame, and of the processor."""
    digest = hashlib.sha256()
    for name in _MODULES:
        digest.update((Path(__file__).parent / f"{name}.py").read_bytes())
    versions = [f"{name} {metadata.version(name)}" for name in _LIBRARIES]
    processor = (platform.machine(), llvmlite.binding.get_host_cpu_name())
    digest.update(repr((versions, processor)).encode())
    return digest.hexdigest()


class FrameStore:
    """Frames of one phantom, array and imaging by pose: simulated once, then looked up."""

    def __init__(self, phantom: Phantom, array: LinearArray, imaging: Imaging) -> None:
        """Nothing is read or simulated yet."""
        self._scene = (phantom, array, imaging)
        self._frames: dict[Pose, Frame] = {}
        self._loaded = False
        self._key = hashlib.sha256(repr((*self._scene, _simulator())).encode()).hexdigest()
        self.path = cache_folder() / f"frames-{self._key[:32]}.npz"

    def frame(self, pose: Pose) -> Frame:
        """Return the frame from `pose`, (height_px, width_px) uint8, read-only."""
        frame = self._frames.get(pose)
        if frame is None:
            self._load()
            frame = self._frames.get(pose)
        if frame is None:
            frame = self._keep(pose, scan(self._scene[0], pose, *self._scene[1:]))
        return frame

    def prepare(self, poses: Iterable[Pose], progress: Progress | None = None) -> None:
        """Simulate what is missing of `poses` and keep it on disk; `progress(done, total)` after each."""
        self._load()
        missing = [pose for pose in dict.fromkeys(poses) if pose not in self._frames]
        missing.sort(key=lambda pose: pose.focal_depth_mm)  # the simulator holds tables of some depths only
        for done, pose in enumerate(missing, start=1):
            self.frame(pose)
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

    def _keep(self, pose: Pose, frame: Frame) -> Frame:
        frame.flags.writeable = False
        self._frames[pose] = frame
        return frame

    def _load(self) -> None:
        if self._loaded:
            return
        self._loaded = True
        try:
            # Opened here: of a damaged archive, NumPy would leave it open.
            with self.path.open("rb") as raw, np.load(raw, allow_pickle=False) as file:
                poses, frames, checksum = file["poses"], file["frames"], str(file["checksum"])
            if checksum != _checksum(self._key, poses, frames):
                raise ValueError("its checksum is wrong")
            os.utime(self.path)  # used lately: dropped last
        except (FileNotFoundError, NotADirectoryError):
            return
        except Exception as error:  # a damaged archive raises nearly anything
            warnings.warn(
                f"frames are simulated again, as {self.path} cannot be used: {error}.", stacklevel=3
            )
            return
        for pose, frame in zip(poses.tolist(), frames, strict=True):
            self._keep(Pose(*pose), frame)

    def _save(self) -> None:
        poses = np.array([(p.x_mm, p.focal_depth_mm, p.angle_deg) for p in self._frames], dtype=np.int32)
        frames = np.stack(list(self._frames.values()))
        temporary = None
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with tempfile.NamedTemporaryFile(dir=self.path.parent, suffix=".tmp", delete=False) as file:
                temporary = file.name
                np.savez(file, poses=poses, frames=frames, checksum=_checksum(self._key, poses, frames))
                file.flush()
                os.fsync(file.fileno())
            os.replace(temporary, self.path)
            _prune(self.path)
        except OSError as error:
            if temporary is not None:
                Path(temporary).unlink(missing_ok=True)
            warnings.warn(f"frames are not kept on disk: {error}.", stacklevel=3)


@lru_cache(maxsize=8)
def frame_store(phantom: Phantom, array: LinearArray, imaging: Imaging) -> FrameStore:
    """Return the store of this scene that the whole process shares."""
    return FrameStore(phantom, array, imaging)


def _checksum(key: str, poses: npt.NDArray[np.int32], frames: Frame) -> str:
    """Return a hash of what a file holds, shapes included, and of its scene: a renamed file is foreign."""
    header = repr((key, poses.shape, poses.dtype.str, frames.shape, frames.dtype.str)).encode()
    return hashlib.sha256(header + poses.tobytes() + frames.tobytes()).hexdigest()


def _prune(kept: Path) -> None:
    """Drop the files used longest ago until the folder holds at most MAX_CACHE_BYTES; `kept` stays."""
    files = sorted(
        ((path.stat().st_mtime, path.stat().st_size, path) for path in kept.parent.glob("frames-*.npz")),
        reverse=True,
    )
    total = 0
    for _, size, path in files:
        total += size
        if total > MAX_CACHE_BYTES and path != kept:
            path.unlink(missing_ok=True)
