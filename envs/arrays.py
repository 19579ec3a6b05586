"""Arrays that a user may pass, checked alike everywhere."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt


def real(name: str, values: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return a new array of `values`.

    Raises:
        ValueError: If they are not real numbers: complex ones would lose a part, and texts are none.
    """
    array = np.asarray(values)
    if array.dtype.kind not in "biuf":
        raise ValueError(f"{name} must be real numbers, not {array.dtype}.")
    return array.astype(np.float64)
