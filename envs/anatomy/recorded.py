"""A recorded 3-D ultrasound image as tissue: its frames are slices."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, NoReturn

import numpy as np
import numpy.typing as npt

from usbench.envs.anatomy.tissue import Anatomy
from usbench.envs.pose import Pose, cos_deg, sin_deg

Frame = npt.NDArray[np.uint8]

# Of a pixel along an edge, as many are averaged at most.
MAX_PARTS = 8


@dataclass(frozen=True, kw_only=True)
class Recording(Anatomy):
    """A recorded 3-D ultrasound image: frames are its slices, with the focus that it was recorded with."""

    has_focus: ClassVar[bool] = False

    @property
    def attenuation_db_per_cm_mhz(self) -> float:
        """0: what was lost on the way is in the image already."""
        return 0.0

    def in_view(self, pose: Pose, half_width_m: float, half_thickness_m: float) -> NoReturn:
        """Raise ValueError: there are no scatterers to be simulated."""
        raise ValueError("a recorded image has no scatterers: its frames are slices.")

    def recorded_frame(self, pose: Pose, shape: tuple[int, int], pixel_size: float) -> Frame:
        """Return the slice in the image plane of `pose`, (height_px, width_px) uint8.

        Pixels are means over what they cover: the largest voxel is white, and black is outside.
        """
        height, width = shape
        parts = min(math.ceil(1e3 * pixel_size / float(self.volume.spacing_mm.min())), MAX_PARTS)
        depths = (np.arange(height * parts) + 0.5) * pixel_size / parts
        along = (np.arange(width * parts) + 0.5) * pixel_size / parts - width * pixel_size / 2
        z, u = np.meshgrid(depths, along, indexing="ij")
        # `Pose.to_probe` the other way round, for points in the image plane.
        x = 1e-3 * pose.x_mm + cos_deg(pose.angle_deg) * u
        points = np.stack([x, sin_deg(pose.angle_deg) * u, z], axis=-1)
        values = self.volume.sample(self.at(points.reshape(-1, 3)))
        pixels = values.reshape(height, parts, width, parts).mean(axis=(1, 3))
        return np.asarray(np.rint(255 / self.volume.largest * pixels), dtype=np.uint8)
