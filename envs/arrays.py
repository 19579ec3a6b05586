"""Arrays that a user may pass, checked alike everywhere."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from usbench.checks import number

# Echoes of many are added up in single precision, which ends at 3e38.
_STRONGEST = 1e30


def real(name: str, values: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return a new array of `values`.

    Raises:
        ValueError: If they are not real numbers: complex ones would lose a part, and texts are none.
    """
    array = np.asarray(values)
    if array.dtype.kind not in "biuf":
        raise ValueError(f"{name} must be real numbers, not {array.dtype}.")
    return array.astype(np.float64)


def check_amplitudes(amplitudes: npt.NDArray[np.float64]) -> None:
    """Raise ValueError if an amplitude of scatterers (n,) is beyond 1e30."""
    if len(amplitudes):
        strongest = int(np.abs(amplitudes).argmax())
        name = f"amplitude of scatterer {strongest + 1}"
        number(name, float(amplitudes[strongest]), low=-_STRONGEST, high=_STRONGEST)
