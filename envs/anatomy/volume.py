"""A 3-D image on a grid at right angles: its voxels, where they lie, and what is between them."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import ndimage

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Volume:
    """Voxels on a grid at right angles, anywhere in the world of the file (of patients: left, back, head).

    Attributes:
        voxels: Not negative, (n_k, n_j, n_i): the axis i of the file comes last.
        spacing_mm: From voxel to voxel along i, j, k, (3,).
        origin_mm: Centre of the first voxel, (3,).
        directions: Unit vectors of i, j, k as columns, (3, 3).
    """

    voxels: npt.NDArray[Any]
    spacing_mm: Array
    origin_mm: Array
    directions: Array

    @cached_property
    def digest(self) -> str:
        """A hash of the voxels and of where they lie, whatever the file is called."""
        places = (self.spacing_mm, self.origin_mm, self.directions)
        header = repr((self.voxels.shape, self.voxels.dtype.str, [place.tolist() for place in places]))
        digest = hashlib.sha256(header.encode())
        digest.update(np.ascontiguousarray(self.voxels).data)
        return digest.hexdigest()

    @cached_property
    def largest(self) -> float:
        """The largest voxel."""
        return float(self.voxels.max())

    @property
    def corners_mm(self) -> Array:
        """Centres of the eight outermost voxels, (8, 3)."""
        index = np.array(list(np.ndindex(2, 2, 2))) * (np.array(self.voxels.shape[::-1]) - 1)
        return np.asarray(self.origin_mm + (index * self.spacing_mm) @ self.directions.T)

    def contains(self, positions_mm: Array) -> npt.NDArray[np.bool_]:
        """Return which of the positions (n, 3) lie between voxels, (n,)."""
        index = self._index(positions_mm)
        inside = (index >= 0) & (index <= np.array(self.voxels.shape[::-1]) - 1)
        return np.asarray(inside.all(axis=1))

    def sample(self, positions_mm: Array) -> npt.NDArray[np.float32]:
        """Return the values at positions (n, 3), (n,): interpolated linearly, 0 outside."""
        index = self._index(positions_mm)[:, ::-1].T
        return np.asarray(
            ndimage.map_coordinates(self.voxels, index, np.float32, order=1, mode="constant", prefilter=False)
        )

    def _index(self, positions_mm: Array) -> Array:
        # The directions are at right angles, so that transposed they are their own inverse.
        index = (positions_mm - self.origin_mm) @ self.directions / self.spacing_mm
        # Rounding must not put the outermost voxels outside.
        nearest = np.rint(index)
        return np.asarray(np.where(np.abs(index - nearest) < 1e-6, nearest, index))
