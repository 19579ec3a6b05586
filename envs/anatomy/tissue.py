"""A user's own anatomy: a 3-D image as tissue to be simulated, or as a recording to be sliced anew."""

from __future__ import annotations

import abc
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar, Self, cast

import numpy as np
import numpy.typing as npt

from usbench.checks import non_negative, number, positive, whole_number
from usbench.envs.anatomy.placement import Placement
from usbench.envs.anatomy.volume import Volume
from usbench.envs.anatomy.volume_file import read
from usbench.envs.bmode import Imaging
from usbench.envs.phantom import Phantom
from usbench.envs.pose import Pose, cos_deg, sin_deg
from usbench.envs.probe import LinearArray
from usbench.envs.scanner import scan_batch

Array = npt.NDArray[np.float64]
Frame = npt.NDArray[np.uint8]

# Scatterers that fit into memory: 6 million in the box. And parts of a pixel along an edge.
MAX_DENSITY_PER_MM3 = 10.0
MAX_PARTS = 8


@dataclass(frozen=True, kw_only=True)
class Anatomy(abc.ABC):
    """A box of tissue that is a 3-D image; where the image ends there is nothing.

    Attributes:
        path: The file; no part of what the anatomy is, so that it may be moved.
        digest: Of the voxels and where they lie: another content is another anatomy.
        target: The pose that shows best what is looked for.
        placement: How the image lies under the probe.
    """

    path: str = field(compare=False, repr=False)
    digest: str
    target: Pose = Pose()
    placement: Placement = Placement()

    # What is examined: as far as the probe reaches, as of the paper's phantom.
    width_mm: ClassVar[float] = 80.0
    height_mm: ClassVar[float] = 80.0
    depth_mm: ClassVar[float] = 90.0
    # Whether frames depend on the focal depth.
    has_focus: ClassVar[bool]

    @classmethod
    def read(cls, path: str | Path, *, target: Pose | None = None, **settings: Any) -> Self:
        """Return the anatomy in a NIfTI, MHA or NRRD file.

        Args:
            path: The file.
            target: The pose that shows best what is looked for; None to look around for it.
            settings: The other attributes.

        Raises:
            FileNotFoundError: If there is no such file.
            ModuleNotFoundError: If SimpleITK is not installed.
            TypeError: If a setting is unknown or of the wrong type.
            ValueError: If the file or a setting cannot be used, the probe misses the image, or the target is
                not in it.
        """
        path = Path(path).resolve()
        anatomy = cls(path=str(path), digest=read(path).digest, target=target or Pose(), **settings)
        anatomy.placement.check(anatomy.volume, anatomy.width_mm, anatomy.depth_mm)
        if target is not None:
            anatomy.check_target()
        return anatomy

    @property
    def volume(self) -> Volume:
        """The image; ValueError if the file holds another by now."""
        return _volume(self.path, self.digest)

    def at(self, positions: Array) -> Array:
        """Return where positions (n, 3) m under the probe are in the file's world, (n, 3) mm."""
        zero, axes = self.placement.frame(self.volume)
        return np.asarray(zero + 1e3 * positions @ axes.T)

    def check_target(self) -> None:
        """Raise ValueError if the target does not lie in the image, or below what frames show."""
        half = int(self.width_mm / 2)
        x_mm, depths_mm = np.arange(-half, half + 1), np.arange(int(self.depth_mm) + 1)
        plane = np.array([(x, 0, z) for x in x_mm for z in depths_mm]) * 1e-3
        inside = self.volume.contains(self.at(plane)).reshape(len(x_mm), len(depths_mm))
        _check_within("x_mm", self.target.x_mm, x_mm[inside.any(axis=1)])
        # Without a focus, the depth of one that stands for nothing may be below the image.
        allowed = depths_mm[inside[self.target.x_mm + half]] if self.has_focus else depths_mm[1:]
        where = "where the image is" if self.has_focus else "as deep as frames are"
        _check_within("focal_depth_mm", self.target.focal_depth_mm, allowed, where)

    @abc.abstractmethod
    def frames(self, poses: Sequence[Pose], array: LinearArray, imaging: Imaging) -> Sequence[Frame]:
        """Return the frame from every pose, (height_px, width_px) uint8 each."""


@dataclass(frozen=True, kw_only=True)
class Echogenicity(Anatomy):
    """Tissue whose scatterers are as strong as the image is bright; frames are simulated.

    Amplitudes are normal, their standard deviation is the image's value in between the voxels, as in J. A.
    Jensen and P. Munk, "Computer phantoms for simulating ultrasound B-mode and CFM images", Acoustical
    Imaging 23 (1997) 75-80. Speckle is the seed's.

    Attributes:
        seed: Of the scatterers, a whole number from 0.
        density_per_mm3: Scatterers per volume; the default is that of the paper's object.
        dynamic_range_db: Of an image that is in decibels, as a scanner shows them, from black to its largest
            voxel; None for one that is the strength of echoes itself.
        attenuation_db_per_cm_mhz: As of a `Phantom`.
    """

    seed: int = 0
    density_per_mm3: float = 10_000 / (40.0 * 10.0 * 90.0)
    dynamic_range_db: float | None = None
    attenuation_db_per_cm_mhz: float = 0.0
    has_focus: ClassVar[bool] = True

    def __post_init__(self) -> None:
        """Hold the values as plain ones, or refuse them."""
        density = number("density_per_mm3", self.density_per_mm3, low=0, high=MAX_DENSITY_PER_MM3, above=True)
        object.__setattr__(self, "density_per_mm3", density)
        object.__setattr__(self, "seed", whole_number("seed", self.seed, low=0))
        if self.dynamic_range_db is not None:
            range_db = positive("dynamic_range_db", self.dynamic_range_db)
            object.__setattr__(self, "dynamic_range_db", range_db)
        loss = non_negative("attenuation_db_per_cm_mhz", self.attenuation_db_per_cm_mhz)
        object.__setattr__(self, "attenuation_db_per_cm_mhz", loss)

    def in_view(
        self, pose: Pose, half_width_m: float = 0.020, half_thickness_m: float = 0.005
    ) -> tuple[Array, Array]:
        """Return positions (n, 3) m in the probe's frame and amplitudes (n,) of what is seen from `pose`."""
        tissue, amplitudes = _scatterers(self)
        positions = pose.to_probe(tissue)
        seen = (np.abs(positions[:, 0]) <= half_width_m) & (np.abs(positions[:, 1]) <= half_thickness_m)
        return positions[seen], amplitudes[seen]

    def frames(self, poses: Sequence[Pose], array: LinearArray, imaging: Imaging) -> Sequence[Frame]:
        """Return the simulated frame from every pose, (height_px, width_px) uint8 each."""
        # The scanner asks a phantom for nothing but `in_view` and its attenuation.
        phantom = cast(Phantom, self)
        return list(scan_batch([(phantom, pose) for pose in poses], array, imaging))


@dataclass(frozen=True, kw_only=True)
class Recording(Anatomy):
    """A recorded 3-D ultrasound image: frames are its slices, with the focus that it was recorded with."""

    has_focus: ClassVar[bool] = False

    def frames(self, poses: Sequence[Pose], array: LinearArray, imaging: Imaging) -> Sequence[Frame]:
        """Return the slice in the image plane of every pose, (height_px, width_px) uint8 each."""
        return [self._slice(pose, imaging) for pose in poses]

    def _slice(self, pose: Pose, imaging: Imaging) -> Frame:
        """Return pixels as means over what they cover: the largest voxel is white, and black is outside."""
        height, width, size = imaging.height_px, imaging.width_px, imaging.pixel_size
        parts = min(math.ceil(1e3 * size / float(self.volume.spacing_mm.min())), MAX_PARTS)
        depths = (np.arange(height * parts) + 0.5) * size / parts
        along = (np.arange(width * parts) + 0.5) * size / parts - width * size / 2
        z, u = np.meshgrid(depths, along, indexing="ij")
        # `Pose.to_probe` the other way round, for points in the image plane.
        x = 1e-3 * pose.x_mm + cos_deg(pose.angle_deg) * u
        points = np.stack([x, sin_deg(pose.angle_deg) * u, z], axis=-1)
        values = self.volume.sample(self.at(points.reshape(-1, 3)))
        pixels = values.reshape(height, parts, width, parts).mean(axis=(1, 3))
        return np.asarray(np.rint(255 / self.volume.largest * pixels), dtype=np.uint8)


# Not the volume itself in an anatomy, so that a pickled one is its configuration.
@lru_cache(maxsize=2)
def _volume(path: str, digest: str) -> Volume:
    volume = read(path)
    if volume.digest != digest:
        raise ValueError(
            f"the volume {path!r} has been changed: its digest must be {digest[:16]}, not "
            f"{volume.digest[:16]}."
        )
    return volume


@lru_cache(maxsize=4)
def _scatterers(anatomy: Echogenicity) -> tuple[Array, Array]:
    """Draw positions (n, 3) m and amplitudes (n,), read-only; where the image is black there are none."""
    rng = np.random.default_rng(anatomy.seed)
    half_mm = np.array([anatomy.width_mm, anatomy.height_mm, anatomy.depth_mm]) / 2
    count = round(anatomy.density_per_mm3 * float(np.prod(2 * half_mm)))
    positions = (rng.uniform(-half_mm, half_mm, (count, 3)) + [0.0, 0.0, half_mm[2]]) * 1e-3
    shade = anatomy.volume.sample(anatomy.at(positions)) / anatomy.volume.largest
    decibels = anatomy.dynamic_range_db
    strength = shade if decibels is None else 10 ** ((shade - 1) * decibels / 20)
    amplitudes = rng.normal(0.0, 1.0, count) * strength
    positions, amplitudes = positions[shade > 0], amplitudes[shade > 0]
    positions.flags.writeable = False
    amplitudes.flags.writeable = False
    return positions, amplitudes


def _check_within(
    name: str, value: int, allowed_mm: npt.NDArray[np.int64], where: str = "where the image is"
) -> None:
    if not len(allowed_mm):
        raise ValueError(
            "no image plane of the probe meets the image: see center_x_mm, center_y_mm and skin_mm."
        )
    low, high = int(allowed_mm[0]), int(allowed_mm[-1])
    if not low <= value <= high:
        raise ValueError(f"the target's {name} must be in [{low}, {high}], {where}, not {value}.")
