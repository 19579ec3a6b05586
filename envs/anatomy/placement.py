"""How an image lies under the probe: which of its axes is which, and where the skin and the middle are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from usbench.checks import number
from usbench.envs.anatomy.volume import Volume

Array = npt.NDArray[np.float64]

# Axes of the file's world, and those of its voxels.
AXES = tuple(f"{sign}{axis}" for axis in "xyzijk" for sign in ("", "-"))


@dataclass(frozen=True)
class Placement:
    """Which axes of an image are the probe's, and where the probe's zero is.

    An axis is x, y or z of the file's world (of patients: to the left, back and head) or i, j or k of its
    voxels, with a minus for the other way. The third axis, elevation, follows: x lateral, y elevation and
    z depth are right-handed.

    Attributes:
        lateral: Axis along the array at angle 0.
        down: Axis into the depth.
        center_x_mm: Where x = 0 is, from the middle of the image.
        center_y_mm: Where y = 0 is, from the middle of the image.
        skin_mm: Where depth 0 is, below the top of the image.
    """

    lateral: str = "x"
    down: str = "z"
    center_x_mm: float = 0.0
    center_y_mm: float = 0.0
    skin_mm: float = 0.0

    def __post_init__(self) -> None:
        """Hold the values as plain ones, or refuse them."""
        for name in ("lateral", "down"):
            if getattr(self, name) not in AXES:
                raise ValueError(f"{name} must be one of {', '.join(AXES)}, not {getattr(self, name)!r}.")
        for name in ("center_x_mm", "center_y_mm", "skin_mm"):
            object.__setattr__(self, name, number(name, getattr(self, name)))

    def frame(self, volume: Volume) -> tuple[Array, Array]:
        """Return the probe's zero (3,) mm and its axes x, y, z as columns (3, 3) in the file's world.

        Raises:
            ValueError: If the lateral axis and the one down are not at right angles in this file.
        """
        world = dict(zip("xyzijk", [*np.eye(3), *volume.directions.T], strict=True))
        lateral, down = (
            -world[name[1]] if name.startswith("-") else world[name] for name in (self.lateral, self.down)
        )
        if abs(lateral @ down) > 1e-4:
            raise ValueError(
                f"lateral and down must be axes at right angles, not {self.lateral!r} and {self.down!r}."
            )
        axes = np.stack([lateral, np.cross(down, lateral), down], axis=1)
        corners = volume.corners_mm @ axes
        low, high = corners.min(axis=0), corners.max(axis=0)
        top = np.array([*(low + high)[:2] / 2, low[2]])
        return axes @ (top + [self.center_x_mm, self.center_y_mm, self.skin_mm]), axes

    def check(self, volume: Volume, width_mm: float, depth_mm: float) -> None:
        """Raise ValueError if the probe misses the image, wherever it stands on its line of `width_mm`."""
        _, axes = self.frame(volume)
        width, height, depth = np.ptp(volume.corners_mm @ axes, axis=0)
        reach = (width + width_mm) / 2
        ranges = {
            "center_x_mm": (-reach, reach),
            "center_y_mm": (-height / 2, height / 2),
            "skin_mm": (-depth_mm, depth),
        }
        for name, (low, high) in ranges.items():
            value = getattr(self, name)
            if not low <= value <= high:
                raise ValueError(
                    f"{name} must be in [{low:g}, {high:g}], where the probe meets the image, not {value:g}."
                )
