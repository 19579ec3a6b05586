"""Axes of normalised scores begin at 0; what lies below has a mark."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from usbench.figures import style

# Beyond the optimum's 1, so that its marks are whole.
HIGHEST = 1.06
# Of the axis; where the marks of what lies below 0 stand.
CLIPPED_AT = 0.015


def mark_lowest(axis: Any, height: float, lowest: float, color: str) -> None:
    """Mark the lowest score of a row with a triangle and its number if it lies below 0."""
    if lowest < 0:
        axis.plot(CLIPPED_AT, height, "<", color=color, markersize=5)
        axis.annotate(
            f"{lowest:.2f}",
            (CLIPPED_AT, height),
            (5, 2.5),
            textcoords="offset points",
            fontsize=style.SMALL,
            va="bottom",
        )


def mark_below(axis: Any, at: ArrayLike, scores: ArrayLike, color: str) -> None:
    """Mark those scores of a curve over `at` that lie below 0 with triangles."""
    below = np.asarray(at)[np.asarray(scores) < 0]
    axis.plot(below, np.full(len(below), CLIPPED_AT), "v", color=color, markersize=4)
