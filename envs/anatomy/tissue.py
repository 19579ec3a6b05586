"""Custom anatomy: what every 3-D image is that is examined, simulated or recorded."""

from __future__ import annotations

import abc
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
import numpy.typing as npt

from usbench.checks import check_type
from usbench.envs.anatomy.placement import Placement
from usbench.envs.anatomy.volume import Volume
from usbench.envs.anatomy.volume_file import read
from usbench.envs.pose import Pose

Array = npt.NDArray[np.float64]
Frame = npt.NDArray[np.uint8]


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
    # Nobody knows its outline.
    object_of_interest: ClassVar[None] = None

    def __post_init__(self) -> None:
        """Check the types.

        Raises:
            TypeError: If `target` is no `Pose`, or `placement` no `Placement`.
        """
        check_type("target", self.target, Pose)
        check_type("placement", self.placement, Placement)

    @classmethod
    def read(cls, path: str | Path, *, target: Pose | None = None, **settings: Any) -> Self:
        """Return the anatomy in a NIfTI, MHA or NRRD file.

        Args:
            path: The file.
            target: The pose that shows best what is looked for. None to look around for it: environments
                then take x = 0, a focal depth of 50 mm and the angle 0 for it.
            settings: The other attributes.

        Raises:
            FileNotFoundError: If there is no such file.
            ModuleNotFoundError: If SimpleITK is not installed.
            TypeError: If a setting is unknown or of the wrong type.
            ValueError: If the file or a setting cannot be used, the probe misses the image, or the target is
                not in it.
        """
        path = Path(path).resolve()
        volume = _keep(read(path))
        anatomy = cls(path=str(path), digest=volume.digest, target=target or Pose(), **settings)
        anatomy.placement.check(volume, anatomy.width_mm, anatomy.depth_mm)
        if target is not None:
            anatomy.check_target()
        return anatomy

    @property
    def volume(self) -> Volume:
        """The image, its arrays read-only; ValueError if the file holds another by now."""
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

    @property
    def shown(self) -> Self:
        """This anatomy without its target, of which frames know nothing."""
        return replace(self, target=Pose())

    @property
    @abc.abstractmethod
    def attenuation_db_per_cm_mhz(self) -> float:
        """What sound loses on its way, see `Tissue`."""

    @abc.abstractmethod
    def in_view(self, pose: Pose, half_width_m: float, half_thickness_m: float) -> tuple[Array, Array]:
        """Return positions (n, 3) m and amplitudes (n,) of what is seen from `pose`, see `Tissue`.

        Raises:
            ValueError: If the tissue is a recorded image, which has no scatterers.
        """

    @abc.abstractmethod
    def recorded_frame(self, pose: Pose, shape: tuple[int, int], pixel_size: float) -> Frame | None:
        """Return the frame of a recorded image, `shape` (height_px, width_px) uint8; None where simulated.

        Args:
            pose: Of the probe.
            shape: Rows and columns of the frame.
            pixel_size: Side of a pixel, m.
        """


# The last volumes that were read, by digest, wherever the file is: not in an anatomy, whose pickle is its
# configuration.
_kept: dict[str, Volume] = {}
_N_KEPT = 2


def _volume(path: str, digest: str) -> Volume:
    if (kept := _kept.get(digest)) is not None:
        return kept
    volume = read(path)
    if volume.digest != digest:
        raise ValueError(
            f"the volume {path!r} has been changed: its digest must be {digest[:16]}, not "
            f"{volume.digest[:16]}."
        )
    return _keep(volume)


def _keep(volume: Volume) -> Volume:
    """Keep a volume for all anatomies of it, its arrays read-only; return it."""
    for array in (volume.voxels, volume.spacing_mm, volume.origin_mm, volume.directions):
        array.flags.writeable = False
    _kept[volume.digest] = volume
    for oldest in list(_kept)[:-_N_KEPT]:
        _kept.pop(oldest, None)
    return volume


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
