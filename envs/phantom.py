"""The tissue phantom: the object's balls, and scatterers drawn once from a seed and fixed to the tissue."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from usbench.checks import non_negative, positive, whole_number
from usbench.envs.attenuation import checked_attenuation
from usbench.envs.pose import Pose, cos_deg, sin_deg

# All of them are in memory.
MOST_SCATTERERS = 10_000_000
_VIEW_MM3 = 40.0 * 10.0 * 90.0  # the volume in view, for which the paper's authors give their densities


@dataclass(frozen=True)
class Ball:
    """A ball with its centre (x, y, z) and radius in mm."""

    center_mm: tuple[float, float, float]
    radius_mm: float

    def contains(self, positions_mm: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
        """Return which of the positions (n, 3) mm lie in the ball, (n,)."""
        inside: npt.NDArray[np.bool_] = (
            np.square(positions_mm - np.asarray(self.center_mm)).sum(axis=1) <= self.radius_mm**2
        )
        return inside


@dataclass(frozen=True)
class ObjectOfInterest:
    """A body with a head above it and four legs, all balls with their centres in one vertical plane.

    Attributes:
        x_mm: Lateral position of the body's centre, whole mm.
        depth_mm: Depth of the body's centre, whole mm.
        angle_deg: Rotation of the plane about the vertical axis through the body's centre, whole degrees.
        scale: Size relative to the paper's object.
        contrast: Standard deviation of the scatterers' amplitudes, relative to the tissue around.
        body_radius_mm: Radius of the body at scale 1.
        head_radius_mm: Radius of the head at scale 1.
        leg_radius_mm: Radius of each leg at scale 1.
    """

    x_mm: int = 0
    depth_mm: int = 50
    angle_deg: int = 0
    scale: float = 1.0
    contrast: float = 10.0
    body_radius_mm: float = 12.0
    head_radius_mm: float = 6.0
    leg_radius_mm: float = 4.0

    def __post_init__(self) -> None:
        """Hold the values as plain numbers, or refuse them."""
        for name in ("x_mm", "depth_mm", "angle_deg"):
            object.__setattr__(self, name, whole_number(name, getattr(self, name)))
        for name in ("scale", "body_radius_mm", "head_radius_mm", "leg_radius_mm"):
            object.__setattr__(self, name, positive(name, getattr(self, name)))
        object.__setattr__(self, "contrast", non_negative("contrast", self.contrast))
        object.__setattr__(self, "angle_deg", self.angle_deg % 360)

    @property
    def upright_balls(self) -> tuple[Ball, ...]:
        """The balls around the body's centre at angle 0: body, head, then the legs."""
        body, head, leg = (
            self.scale * radius for radius in (self.body_radius_mm, self.head_radius_mm, self.leg_radius_mm)
        )
        diagonal = (0.9 * body + leg) / math.sqrt(2)
        legs = tuple(Ball((x, 0.0, z), leg) for z in (-diagonal, diagonal) for x in (-diagonal, diagonal))
        return (Ball((0.0, 0.0, 0.0), body), Ball((0.0, 0.0, -(0.9 * body + head)), head), *legs)

    @property
    def balls(self) -> tuple[Ball, ...]:
        """The balls in the phantom: body, head, then the legs."""
        upright = self.upright_balls
        centers = self.to_phantom(np.array([ball.center_mm for ball in upright])).tolist()
        return tuple(Ball((x, y, z), b.radius_mm) for (x, y, z), b in zip(centers, upright, strict=True))

    def to_phantom(self, positions_mm: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return where positions (n, 3) mm around the upright body's centre are in the phantom."""
        x, y, z = positions_mm.T
        cosine, sine = cos_deg(self.angle_deg), sin_deg(self.angle_deg)
        return np.stack([self.x_mm + cosine * x - sine * y, sine * x + cosine * y, self.depth_mm + z], axis=1)


@dataclass(frozen=True)
class Phantom:
    """A box of tissue with the object in it; equal configurations have equal scatterers.

    Attributes:
        seed: Seed of the scatterers, a whole number from 0.
        object_of_interest: What the examination looks for.
        width_mm: Extent in x, centred at 0.
        height_mm: Extent in y (elevation), centred at 0.
        depth_mm: Extent in z, from 0 down.
        tissue_density_per_mm3: Scatterers per volume outside the object.
        object_density_per_mm3: Scatterers per volume inside the object.
        tissue_amplitude_std: Standard deviation of the normal amplitudes outside the object.
        attenuation_db_per_cm_mhz: What sound loses on its way, everywhere alike; 0.3 to 0.7 in soft tissue,
            at most 1.

    Raises:
        TypeError: If an attribute has a wrong type.
        ValueError: If a value is not allowed; the message says what is.
    """

    seed: int = 0
    object_of_interest: ObjectOfInterest = ObjectOfInterest()
    width_mm: float = 80.0
    height_mm: float = 80.0
    depth_mm: float = 90.0
    tissue_density_per_mm3: float = 1_000 / _VIEW_MM3
    object_density_per_mm3: float = 10_000 / _VIEW_MM3
    tissue_amplitude_std: float = 1.0
    attenuation_db_per_cm_mhz: float = 0.0

    has_focus: ClassVar[bool] = True

    def __post_init__(self) -> None:
        """Hold the values as plain numbers, or refuse them."""
        object.__setattr__(self, "seed", whole_number("seed", self.seed, low=0))
        if not isinstance(self.object_of_interest, ObjectOfInterest):
            raise TypeError(
                f"object_of_interest must be an ObjectOfInterest, not {self.object_of_interest!r}."
            )
        for name in ("width_mm", "height_mm", "depth_mm"):
            object.__setattr__(self, name, positive(name, getattr(self, name)))
        for name in (
            "tissue_density_per_mm3",
            "object_density_per_mm3",
            "tissue_amplitude_std",
        ):
            object.__setattr__(self, name, non_negative(name, getattr(self, name)))
        density = max(self.tissue_density_per_mm3, self.object_density_per_mm3)
        n_scatterers = density * self.width_mm * self.height_mm * self.depth_mm
        if not n_scatterers <= MOST_SCATTERERS:  # also of inf times 0
            raise ValueError(
                f"a phantom must have at most {MOST_SCATTERERS:g} scatterers, its largest density times its "
                f"volume, not {n_scatterers:g}."
            )
        loss = checked_attenuation(self.attenuation_db_per_cm_mhz)
        object.__setattr__(self, "attenuation_db_per_cm_mhz", loss)
        for ball in self.object_of_interest.balls:
            (x, y, z), r = ball.center_mm, ball.radius_mm
            if (
                abs(x) + r > self.width_mm / 2
                or abs(y) + r > self.height_mm / 2
                or z < r
                or z + r > self.depth_mm
            ):
                raise ValueError(
                    f"the object must lie inside the phantom of {self.width_mm:g} x {self.height_mm:g} "
                    f"x {self.depth_mm:g} mm, unlike its ball of radius {r:g} mm at ({x:g}, {y:g}, {z:g})."
                )

    @property
    def target(self) -> Pose:
        """The pose that shows the object best: above its centre, focused on it, in its plane."""
        ooi = self.object_of_interest
        return Pose(ooi.x_mm, ooi.depth_mm, ooi.angle_deg)

    @property
    def shown(self) -> Phantom:
        """This phantom, which its frames show as a whole."""
        return self

    def recorded_frame(self, pose: Pose, shape: tuple[int, int], pixel_size: float) -> None:
        """Return None: frames of a phantom are simulated."""

    @property
    def positions(self) -> npt.NDArray[np.float64]:
        """Positions of all scatterers, (n, 3) m, read-only."""
        return _scatterers(self)[0]

    @property
    def amplitudes(self) -> npt.NDArray[np.float64]:
        """Amplitudes of all scatterers, (n,), read-only."""
        return _scatterers(self)[1]

    def in_view(
        self, pose: Pose, half_width_m: float, half_thickness_m: float
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Return positions (n, 3) m and amplitudes (n,) as seen from the probe: see `Scatterers`."""
        seen, which = pose.in_view(self.positions, half_width_m, half_thickness_m)
        return seen, self.amplitudes.take(which)


def keep_scatterers(n_phantoms: int) -> None:
    """Let this process keep the scatterers of `n_phantoms` phantoms, half a megabyte each.

    Sixteen are kept anyway. To draw them takes as long as a frame: many environments in step, each with a
    phantom of its own, would draw all of them again at every step.
    """
    global _scatterers
    if n_phantoms > _scatterers.cache_parameters()["maxsize"]:
        _scatterers = lru_cache(maxsize=n_phantoms)(_drawn)


# Outside the dataclass, so that a pickled phantom is its configuration and not half a megabyte of arrays.
def _drawn(phantom: Phantom) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Draw the scatterers of `phantom`: positions (n, 3) m and amplitudes (n,).

    Two populations: round(density * volume) positions, uniform over the whole phantom for the tissue and over
    the object's bounding box for the object; kept are those of the first that lie outside all balls and those
    of the second that lie inside one. The tissue is drawn first, the object in coordinates around its body:
    with one seed, an object that moves takes its speckle along and leaves that of the tissue unchanged.
    """
    rng = np.random.default_rng(phantom.seed)
    ooi = phantom.object_of_interest

    half_mm = np.array([phantom.width_mm / 2, phantom.height_mm / 2, phantom.depth_mm / 2])
    n_tissue = round(phantom.tissue_density_per_mm3 * float(np.prod(2 * half_mm)))
    tissue = rng.uniform(-half_mm, half_mm, (n_tissue, 3)) + [0.0, 0.0, half_mm[2]]
    tissue_amplitudes = rng.normal(0.0, phantom.tissue_amplitude_std, n_tissue)
    outside = ~np.any([ball.contains(tissue) for ball in ooi.balls], axis=0)

    balls = ooi.upright_balls
    low = np.min([np.subtract(ball.center_mm, ball.radius_mm) for ball in balls], axis=0)
    high = np.max([np.add(ball.center_mm, ball.radius_mm) for ball in balls], axis=0)
    n_object = round(phantom.object_density_per_mm3 * float(np.prod(high - low)))
    candidates = rng.uniform(low, high, (n_object, 3))
    object_amplitudes = rng.normal(0.0, ooi.contrast * phantom.tissue_amplitude_std, n_object)
    inside = np.any([ball.contains(candidates) for ball in balls], axis=0)

    positions = np.concatenate([tissue[outside], ooi.to_phantom(candidates[inside])]) * 1e-3
    amplitudes = np.concatenate([tissue_amplitudes[outside], object_amplitudes[inside]])
    positions.flags.writeable = False
    amplitudes.flags.writeable = False
    return positions, amplitudes


_scatterers = lru_cache(maxsize=16)(_drawn)
