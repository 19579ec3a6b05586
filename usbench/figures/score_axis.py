"""Axes of normalised scores begin at 0; what lies below has a mark."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from usbench.figures import style

# Beyond the optimum's 1, so that its marks are whole.
HIGHEST = 1.06
# Of what curves are drawn over; nearer arrows would cover each other.
NEAREST = 0.03
# The corners of an arrow whose tip is at the place that it marks: no agent's marker is one.
DOWN = ((0, 0), (0.5, 0.55), (0.17, 0.55), (0.17, 1), (-0.17, 1), (-0.17, 0.55), (-0.5, 0.55), (0, 0))
LEFT = tuple((y, x) for x, y in DOWN)
ARROW = {"markersize": 14, "markeredgecolor": "white", "markeredgewidth": 0.5, "zorder": 4}
# The colour of no agent: of the mark of several.
SEVERAL = "0.35"


def mark_lowest(axis: Any, height: float, lowest: float, color: str) -> None:
    """Mark the lowest score of a row with an arrow and its number if it lies below 0."""
    if lowest < 0:
        axis.plot(0, height, marker=LEFT, color=color, **ARROW)
        axis.annotate(
            f"{lowest:.2f}",
            (0, height),
            (7, 2.5),
            textcoords="offset points",
            fontsize=style.SMALL,
            va="bottom",
        )


def mark_below(axis: Any, curves: Iterable[tuple[ArrayLike, ArrayLike, str]]) -> None:
    """Mark the scores of curves that lie below 0 with arrows on the axis.

    An arrow has the colour of its curve. Where those of several curves would cover each other, a grey
    square with their number stands for them: neither its colour nor its shape is an agent's.

    Args:
        axis: The panel.
        curves: Of each curve where it was measured, its scores there, and its colour.
    """
    known = [(np.asarray(at, float), np.asarray(scores, float), color) for at, scores, color in curves]
    if not known:
        return
    everywhere = np.concatenate([at for at, _, _ in known])
    found = sorted((at, number) for number, (xs, ys, _) in enumerate(known) for at in xs[ys < 0])
    for group in _near(found, NEAREST * float(np.ptp(everywhere))):
        numbers = {number for _, number in group}
        place = float(np.mean([at for at, _ in group]))
        if len(numbers) == 1:
            axis.plot(place, 0, marker=DOWN, color=known[group[0][1]][2], **ARROW)
        else:
            _mark_several(axis, place, len(numbers))


def _mark_several(axis: Any, place: float, number: int) -> None:
    """Mark that the curves of `number` agents lie below 0 at a place."""
    axis.annotate(
        str(number),
        (place, 0),
        (0, 3),
        textcoords="offset points",
        fontsize=style.SMALL,
        color="white",
        ha="center",
        va="bottom",
        zorder=4,
        bbox={"boxstyle": "square,pad=0.2", "facecolor": SEVERAL, "edgecolor": "white", "linewidth": 0.6},
    )


def _near(found: Sequence[tuple[float, int]], width: float) -> list[list[tuple[float, int]]]:
    """Return places in order as groups, each no wider than `width`."""
    groups: list[list[tuple[float, int]]] = []
    for one in found:
        if groups and one[0] - groups[-1][0][0] <= width:
            groups[-1].append(one)
        else:
            groups.append([one])
    return groups
