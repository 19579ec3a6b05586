"""The scanner's settings beside the pose of its probe: centre frequency and dynamic range."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from usbench.coordinates import COORDINATES, POSE
from usbench.envs.bmode import Imaging
from usbench.envs.pose import Pose
from usbench.envs.probe import LinearArray


@dataclass(frozen=True, order=True, kw_only=True)
class Setup(Pose):
    """A pose with settings that stand in place of the array's and the imaging's own.

    Attributes:
        frequency_khz: Centre frequency of excitation and elements, whole kHz.
        dynamic_range_db: Shown below the frame's maximum, whole dB.
    """

    frequency_khz: int = 3500
    dynamic_range_db: int = 60


def tuned(pose: Pose, array: LinearArray, imaging: Imaging) -> tuple[Pose, LinearArray, Imaging]:
    """Return the plain pose, and array and imaging with its settings where it has any."""
    if not isinstance(pose, Setup):
        return pose, array, imaging
    return (
        Pose(**{name: getattr(pose, name) for name in POSE}),
        replace(array, center_frequency=pose.frequency_khz * 1e3),
        replace(imaging, dynamic_range_db=pose.dynamic_range_db),
    )


def table_of(pose: Pose) -> tuple[int, int]:
    """Return what a table of responses depends on: focal depth (mm), frequency (kHz; 0: the array's own)."""
    return pose.focal_depth_mm, getattr(pose, "frequency_khz", 0)


def as_row(pose: Pose) -> tuple[int, ...]:
    """Return a pose as the numbers of all coordinates of the table, 0 for settings that it does not have."""
    return tuple(getattr(pose, one.name, 0) for one in COORDINATES)


def from_row(row: Sequence[int]) -> Pose:
    """Return the pose of which `as_row` gave the numbers."""
    values = {one.name: number for one, number in zip(COORDINATES, row, strict=True)}
    return Setup(**values) if values["frequency_khz"] else Pose(**{name: values[name] for name in POSE})


def in_words(pose: Pose) -> list[str]:
    """Return the settings as a person reads them; none of a plain pose."""
    if not isinstance(pose, Setup):
        return []
    return [f"{pose.frequency_khz / 1e3:g} MHz", f"{pose.dynamic_range_db} dB"]
