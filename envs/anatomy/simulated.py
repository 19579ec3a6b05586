"""A 3-D image as tissue to be simulated: where it is bright, scatterers are strong."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from usbench.checks import number, positive, whole_number
from usbench.envs.anatomy.tissue import Anatomy
from usbench.envs.attenuation import checked_attenuation
from usbench.envs.pose import Pose

Array = npt.NDArray[np.float64]

# Scatterers that fit into memory: 6 million in the box.
MAX_DENSITY_PER_MM3 = 10.0


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
        super().__post_init__()
        density = number("density_per_mm3", self.density_per_mm3, low=0, high=MAX_DENSITY_PER_MM3, above=True)
        object.__setattr__(self, "density_per_mm3", density)
        object.__setattr__(self, "seed", whole_number("seed", self.seed, low=0))
        if self.dynamic_range_db is not None:
            range_db = positive("dynamic_range_db", self.dynamic_range_db)
            object.__setattr__(self, "dynamic_range_db", range_db)
        loss = checked_attenuation(self.attenuation_db_per_cm_mhz)
        object.__setattr__(self, "attenuation_db_per_cm_mhz", loss)

    def in_view(self, pose: Pose, half_width_m: float, half_thickness_m: float) -> tuple[Array, Array]:
        """Return positions (n, 3) m and amplitudes (n,) as seen from the probe: see `Scatterers`."""
        positions, amplitudes = _scatterers(self)
        seen, which = pose.in_view(positions, half_width_m, half_thickness_m)
        return seen, amplitudes.take(which)

    def recorded_frame(self, pose: Pose, shape: tuple[int, int], pixel_size: float) -> None:
        """Return None: frames are simulated."""


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
