"""The pose of the probe on an exact grid: how a move changes it and how tissue is seen from it.

Axes: x lateral, y elevation, z depth, origin at the centre of the phantom's top face. A positive angle turns
x towards y, which is clockwise for somebody who looks down on the probe.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, fields
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from usbench.checks import whole_number
from usbench.coordinates import BY_NAME


def sin_deg(angle_deg: int) -> float:
    """Return the sine of whole degrees, exact at 0, 90, 180, 270 and equal at mirrored angles.

    `math.sin(math.pi)` is 1.2e-16: enough to make "sin(angle) = 0" false at 180 degrees.
    """
    angle = angle_deg % 360
    if angle >= 180:
        return -sin_deg(angle - 180) if angle > 180 else 0.0
    return math.sin(math.radians(min(angle, 180 - angle)))


def cos_deg(angle_deg: int) -> float:
    """Return the cosine of whole degrees, exact at 0, 90, 180 and 270."""
    return sin_deg(angle_deg + 90)


@dataclass(frozen=True)
class Move:
    """A change of pose, in whole mm and degrees, and of the settings of a `Setup`, in whole kHz and dB."""

    x_mm: int = 0
    focal_depth_mm: int = 0
    angle_deg: int = 0
    frequency_khz: int = 0
    dynamic_range_db: int = 0

    def __post_init__(self) -> None:
        """Hold the values as whole numbers, or refuse them."""
        for name in (one.name for one in fields(self)):
            object.__setattr__(self, name, whole_number(name, getattr(self, name)))


def _limits(name: str) -> Any:
    """Return the field of a coordinate's limits, with those of the table as default."""
    return field(default=BY_NAME[name].limits)


@dataclass(frozen=True)
class Limits:
    """Closed intervals (low, high) of the probe's centre, its focal depth and settings; angles have none."""

    x_mm: tuple[int, int] = _limits("x_mm")
    focal_depth_mm: tuple[int, int] = _limits("focal_depth_mm")
    frequency_khz: tuple[int, int] = _limits("frequency_khz")
    dynamic_range_db: tuple[int, int] = _limits("dynamic_range_db")

    def __post_init__(self) -> None:
        """Hold the values as whole numbers, or refuse them."""
        for name in (one.name for one in fields(self)):
            given = getattr(self, name)
            pair = tuple(given) if isinstance(given, Iterable) and not isinstance(given, str) else ()
            interval = tuple(whole_number(f"a limit of {name}", value) for value in pair)
            if len(interval) != 2 or interval[0] > interval[1]:
                raise ValueError(f"the limits of {name} must be (low, high), not {given!r}.")
            object.__setattr__(self, name, interval)

    def check(self, pose: Pose) -> None:
        """Raise ValueError if `pose` lies outside these limits."""
        for name in coordinates(pose):
            low, high = getattr(self, name, (-math.inf, math.inf))
            if not low <= getattr(pose, name) <= high:
                raise ValueError(f"{name} must be in [{low}, {high}], not {getattr(pose, name)}.")

    def kept(self, name: str, value: int, change: int) -> int:
        """Return the coordinate `name` after a change, or `value` as it was where that would lie outside."""
        low, high = getattr(self, name, (-math.inf, math.inf))
        return value + change if low <= value + change <= high else value


LIMITS = Limits()


@dataclass(frozen=True, order=True)
class Pose:
    """Where the probe is and where it focuses.

    Attributes:
        x_mm: Lateral position of the probe's centre, on the line y = 0, z = 0.
        focal_depth_mm: Depth of the focal point, positive.
        angle_deg: Rotation of the image plane about the probe's own centre, held modulo 360.

    Raises:
        TypeError: If an attribute is no whole number.
        ValueError: If the focus is not below the surface.
    """

    x_mm: int = 0
    focal_depth_mm: int = 50
    angle_deg: int = 0

    def __post_init__(self) -> None:
        """Hold the values as whole numbers, or refuse them."""
        for name in coordinates(self):
            value, row = whole_number(name, getattr(self, name)), BY_NAME[name]
            if row.least is not None and value < row.least:
                raise ValueError(f"{name} must be at least {row.least}, not {value}.")
            object.__setattr__(self, name, value if row.period is None else value % row.period)

    def moved(self, move: Move, limits: Limits = LIMITS) -> Self:
        """Return the pose after `move`; a coordinate that would leave its limits keeps its value."""
        names = coordinates(self)
        return type(self)(
            **{name: limits.kept(name, getattr(self, name), getattr(move, name)) for name in names}
        )

    def to_probe(self, positions: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Return positions of the phantom (n, 3) m as seen from the probe, (n, 3) m.

        The axes of the result are x' along the array, y' elevation (distance from the image plane), z depth.
        """
        points = np.asarray(positions, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 3:
            raise ValueError(f"positions must have shape (n, 3), not {points.shape}.")
        cosine, sine = cos_deg(self.angle_deg), sin_deg(self.angle_deg)
        x, y = points[:, 0] - self.x_mm * 1e-3, points[:, 1]
        return np.stack([cosine * x + sine * y, cosine * y - sine * x, points[:, 2]], axis=1)

    def in_view(
        self, positions: npt.ArrayLike, half_width_m: float, half_thickness_m: float
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.intp]]:
        """Return which positions of the phantom (n, 3) m are in view, as seen from the probe.

        Args:
            positions: In the phantom's axes, (n, 3) m.
            half_width_m: How far the view reaches from the probe's centre along the array.
            half_thickness_m: How far it reaches from the image plane.

        Returns:
            The positions in view in the probe's axes, (m, 3) m, and their places among all, (m,).
        """
        seen = self.to_probe(positions)
        inside = (np.abs(seen[:, 0]) <= half_width_m) & (np.abs(seen[:, 1]) <= half_thickness_m)
        inside &= seen[:, 2] > 0  # a scatterer at depth 0 has no echo
        which = np.flatnonzero(inside)  # several times as fast as the mask
        return seen.take(which, axis=0), which


def coordinates(pose: Pose) -> tuple[str, ...]:
    """Return the names of a pose's coordinates; a `Setup` has more than a plain one."""
    return tuple(pose.__dataclass_fields__)  # as `fields` does, in a tenth of the time
