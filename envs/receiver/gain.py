"""Time gain compensation: echoes from deeper are amplified more, as sound loses more on a longer way."""

from __future__ import annotations

import reprlib
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from usbench.checks import METRES, number, quantity

# The gain at depths (m) in dB.
Curve = tuple[tuple[float, float], ...]

STEEPEST_DB_PER_CM = 100.0
# As far as the simulator reaches, m.
DEEPEST = 0.5
LARGEST_DB = 200.0


def checked(name: str, value: Any) -> float | Curve:
    """Return a gain over depth in plain values: a slope in dB/cm, or a curve of (depth in m, gain in dB).

    Raises:
        TypeError: If `value` is neither a number nor pairs of numbers.
        ValueError: If a number is not allowed, or the depths do not increase.
    """
    value = value.tolist() if isinstance(value, np.ndarray) else value
    if isinstance(value, list | tuple):
        return _curve(name, value)
    try:
        return number(name, value, low=0.0, high=STEEPEST_DB_PER_CM)
    except (TypeError, ValueError) as error:
        allowed = f"a number in [0, {STEEPEST_DB_PER_CM:g}] dB/cm or pairs of depth (m) and gain (dB)"
        raise type(error)(f"{name} must be {allowed}, not {reprlib.repr(value)}.") from None


def _curve(name: str, pairs: list[Any] | tuple[Any, ...]) -> Curve:
    if not pairs or not all(isinstance(pair, list | tuple) and len(pair) == 2 for pair in pairs):
        raise TypeError(
            f"{name} must be a number or pairs of depth (m) and gain (dB), not {reprlib.repr(pairs)}."
        )
    curve = tuple(
        (
            quantity(f"the depth of a pair of {name}", depth, 0.0, DEEPEST, METRES),
            number(f"the gain of a pair of {name}", gain_db, low=-LARGEST_DB, high=LARGEST_DB),
        )
        for depth, gain_db in pairs
    )
    for (before, _), (after, _) in pairwise(curve):
        if after <= before:
            raise ValueError(f"the depths of {name} must increase, not go from {before:g} to {after:g} m.")
    return curve


def gain_db(gain: float | Curve, depths: npt.NDArray[np.floating]) -> npt.NDArray[np.float64]:
    """Return the gain at depths (n,) m in dB, (n,): linear in depth, or between the pairs of a curve.

    Above the surface and beyond the ends of a curve the gain stays as it is there.
    """
    if isinstance(gain, float):
        return np.asarray(gain * 100.0 * np.maximum(depths, 0.0), dtype=np.float64)
    known_depths, known_db = np.array(gain).T
    return np.asarray(np.interp(depths, known_depths, known_db), dtype=np.float64)


def amplified(
    envelopes: npt.NDArray[np.float32], depths: npt.NDArray[np.floating], gain: float | Curve
) -> npt.NDArray[np.float32]:
    """Return envelopes (n_samples, n_lines) times the gain at the depths (n_samples,) m of their samples.

    Up to a common factor, by which the largest gain is 1: an image is relative to its maximum, and no gain
    overflows.
    """
    decibels = gain_db(gain, depths)
    factors = 10.0 ** ((decibels - decibels.max()) / 20)
    return np.asarray(envelopes * factors[:, np.newaxis], dtype=np.float32)
