"""The scanner's settings beside the pose of its probe: centre frequency and dynamic range."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass, replace

from usbench.envs.bmode import Imaging
from usbench.envs.pose import LIMITS, Limits, Move, Pose
from usbench.envs.probe import LinearArray


@dataclass(frozen=True, order=True)
class Setup(Pose):
    """A pose with settings that stand in place of the array's and the imaging's own.

    Attributes:
        frequency_khz: Centre frequency of excitation and elements, whole kHz.
        dynamic_range_db: Shown below the frame's maximum, whole dB.
    """

    frequency_khz: int = 3500
    dynamic_range_db: int = 60

    def __post_init__(self) -> None:
        """Hold the values as whole numbers, or refuse them."""
        super().__post_init__()
        for name in ("frequency_khz", "dynamic_range_db"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be at least 1, not {getattr(self, name)}.")

    def moved(self, move: Move, limits: Limits = LIMITS) -> Setup:
        """Return the setup after `move`; a coordinate that would leave its limits keeps its value."""
        pose = super().moved(move, limits)
        return Setup(
            pose.x_mm,
            pose.focal_depth_mm,
            pose.angle_deg,
            limits.kept("frequency_khz", self.frequency_khz, move.frequency_khz),
            limits.kept("dynamic_range_db", self.dynamic_range_db, move.dynamic_range_db),
        )


def tuned(pose: Pose, array: LinearArray, imaging: Imaging) -> tuple[Pose, LinearArray, Imaging]:
    """Return the plain pose, and array and imaging with its settings where it has any."""
    if not isinstance(pose, Setup):
        return pose, array, imaging
    return (
        Pose(pose.x_mm, pose.focal_depth_mm, pose.angle_deg),
        replace(array, center_frequency=pose.frequency_khz * 1e3),
        replace(imaging, dynamic_range_db=pose.dynamic_range_db),
    )


def table_of(pose: Pose) -> tuple[int, int]:
    """Return what a table of responses depends on: focal depth (mm), frequency (kHz; 0: the array's own)."""
    return pose.focal_depth_mm, getattr(pose, "frequency_khz", 0)


def as_row(pose: Pose) -> tuple[int, ...]:
    """Return a pose as five numbers, the last two 0 where it has no settings."""
    row = astuple(pose)
    return row + (0,) * (5 - len(row))


def from_row(row: Sequence[int]) -> Pose:
    """Return the pose of which `as_row` gave the numbers."""
    return Setup(*row) if row[3] else Pose(*row[:3])


def in_words(pose: Pose) -> list[str]:
    """Return the settings as a person reads them; none of a plain pose."""
    if not isinstance(pose, Setup):
        return []
    return [f"{pose.frequency_khz / 1e3:g} MHz", f"{pose.dynamic_range_db} dB"]
