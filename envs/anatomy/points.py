"""Scatterers of one's own as tissue: positions and amplitudes, from an array or from a file."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from usbench.checks import ConfigurationError
from usbench.envs.anatomy import point_file
from usbench.envs.arrays import check_amplitudes, real
from usbench.envs.attenuation import checked_attenuation
from usbench.envs.pose import Pose

Array = npt.NDArray[np.float64]

# Read, seen from the probe, sorted and summed; measured with 1 and 2 million scatterers.
BYTES_PER_SCATTERER = 300
# Below this nobody waits for long, and every machine has the memory.
_MANY = 1_000_000
# As far from the probe as the simulator goes.
_FARTHEST = 0.5


class PointScatterers:
    """Scatterers at given places, which `scan` takes in place of a phantom.

    Attributes:
        positions: Lateral, elevation and depth, (n, 3) m, read-only.
        amplitudes: Scattering amplitudes, (n,), read-only.
        attenuation_db_per_cm_mhz: What sound loses on its way, everywhere alike, at most 1.
        label: Name that a picture shows.
    """

    has_focus: ClassVar[bool] = True
    # Where the probe may stand.
    width_mm: ClassVar[float] = 2e3 * _FARTHEST

    def __init__(
        self,
        positions: npt.ArrayLike,
        amplitudes: npt.ArrayLike,
        attenuation_db_per_cm_mhz: float = 0.0,
        label: str = "points",
    ) -> None:
        """Hold copies of the values.

        Raises:
            ValueError: If shapes do not fit, there is no scatterer, a value is not a finite real number, an
                amplitude is beyond 1e30, or a scatterer does not lie below the surface and within 0.5 m.
        """
        self.positions = real("positions", positions)
        self.amplitudes = real("amplitudes", amplitudes)
        self.attenuation_db_per_cm_mhz = checked_attenuation(attenuation_db_per_cm_mhz)
        self.label = label
        if self.positions.ndim != 2 or self.positions.shape[1] != 3 or not len(self.positions):
            raise ValueError(f"positions must have shape (n, 3) with n >= 1, not {self.positions.shape}.")
        if self.amplitudes.shape != self.positions.shape[:1]:
            raise ValueError(
                f"amplitudes must have shape {self.positions.shape[:1]} like positions, "
                f"not {self.amplitudes.shape}."
            )
        for name, values in (("positions", self.positions), ("amplitudes", self.amplitudes)):
            if not np.isfinite(values).all():
                raise ValueError(f"{name} must be finite, without NaN.")
            values.flags.writeable = False
        check_amplitudes(self.amplitudes)
        if (highest := float(self.positions[:, 2].min())) <= 0:
            raise ValueError(f"scatterers must lie below the surface (z > 0), not at z = {highest:g} m.")
        if (farthest := float(np.abs(self.positions).max())) > _FARTHEST:
            raise ValueError(
                f"scatterers must be within {_FARTHEST} m, not {farthest:g} m: are the positions in mm?"
            )

    def __repr__(self) -> str:
        """Say all that frames follow from: equal scatterers have equal texts."""
        digest = hashlib.sha256(self.positions.tobytes() + self.amplitudes.tobytes()).hexdigest()
        return f"PointScatterers({digest!r}, {self.attenuation_db_per_cm_mhz!r})"

    def in_view(self, pose: Pose, half_width_m: float, half_thickness_m: float) -> tuple[Array, Array]:
        """Return positions (n, 3) m and amplitudes (n,) as seen from the probe: see `Scatterers`."""
        seen, which = pose.in_view(self.positions, half_width_m, half_thickness_m)
        return seen, self.amplitudes.take(which)


def read_points(path: str | Path, tell: Callable[[str], Any] | None = None) -> PointScatterers:
    """Return the scatterers of a file with columns (.csv) or arrays (.npz) x, y, z and amplitude.

    Positions are in m, or in mm where they are called x_mm, y_mm and z_mm; y is 0 in the image plane of a
    probe that is not turned. Lines of a .csv file that begin with # are comments.

    Args:
        path: The file.
        tell: Told before it starts how much memory a file of many scatterers takes.

    Raises:
        ConfigurationError: If the file cannot be used, or the memory of this machine is too small for it.
    """
    path = Path(path)
    try:
        n = point_file.count(path)
        needed, there = n * BYTES_PER_SCATTERER, memory_bytes()
        amount = f"some {n:.2g} scatterers need some {needed / 1e9:.2g} GB of memory"
        if needed > there:
            raise ValueError(f"{amount}, and this machine has {there / 1e9:.2g} GB.")
        if tell is not None and n > _MANY:
            tell(f"{path}: {amount}.")
        columns = point_file.read(path)
        return PointScatterers(columns[:, :3], columns[:, 3], label=path.stem)
    except OSError as error:
        raise ConfigurationError(
            f"the scatterer file {str(path)!r} cannot be read ({error.strerror or error})."
        ) from error
    except ValueError as error:
        raise ConfigurationError(f"the scatterer file {str(path)!r} cannot be used: {error}") from error


def memory_bytes() -> float:
    """Return the memory of this machine in bytes, infinite where the system does not say it."""
    try:
        return float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    except (AttributeError, OSError, ValueError):  # not on Windows
        return float("inf")
