"""Measures of how well a displayed frame shows an object: of its grey levels inside and around the object."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Frame = npt.NDArray[np.uint8]
Mask = npt.NDArray[np.bool_]

_GREY_LEVELS = 256


def contrast_to_noise(frame: Frame, inside: Mask, around: Mask) -> float:
    """Return |m_i - m_o| / sqrt(s_i^2 + s_o^2) of the pixels inside an object and around it; 0 without any.

    Means and standard deviations of the displayed grey levels (Patterson and Foster 1983): settings of the
    display count, as they do for a person who looks at it.
    """
    if not inside.any() or not around.any():
        return 0.0
    one, other = frame[inside].astype(np.float64), frame[around].astype(np.float64)
    noise = np.sqrt(one.var() + other.var())
    return float(abs(one.mean() - other.mean()) / noise) if noise > 0 else 0.0


def generalized_contrast_to_noise(frame: Frame, inside: Mask, around: Mask) -> float:
    """Return the generalized contrast-to-noise ratio (gCNR), in [0, 1]; 0 without any pixels.

    1 minus the overlap of both histograms (Rodriguez-Molares et al. 2020, Eq. 9), with a bin for every grey
    level: how well an ideal observer tells the two kinds of pixels apart, whatever the display does.
    """
    if not inside.any() or not around.any():
        return 0.0
    return float(1.0 - np.minimum(*_histograms(frame, inside, around)).sum())


def contrast_order(frame: Frame, inside: Mask, around: Mask) -> float:
    """Return the contrast order, in [-1, 1]; 0 without any pixels.

    The mean of sign(a - b) over all pairs of a pixel a inside and a pixel b around ("The Contrast Order",
    arXiv 2602.01622, 2026): the probability that the object is brighter minus the probability that it is
    darker, -1 for a perfect cyst.
    """
    if not inside.any() or not around.any():
        return 0.0
    one, other = _histograms(frame, inside, around)
    darker = np.cumsum(other) - other  # of each grey level, the share of pixels around that are darker
    brighter = 1.0 - darker - other
    return float(one @ (darker - brighter))


def _histograms(frame: Frame, inside: Mask, around: Mask) -> npt.NDArray[np.float64]:
    """Return the shares of the grey levels inside and around, (2, 256)."""
    return np.array(
        [np.bincount(frame[mask], minlength=_GREY_LEVELS) / mask.sum() for mask in (inside, around)]
    )
