"""A panel for each task and noise: as a grid where every task has every noise, else one after the other."""

from collections.abc import Collection, Mapping
from typing import Any

from matplotlib.figure import Figure

from usbench.figures import style
from usbench.results.scores import Cell

# Panels beside each other, at most.
WIDEST = 3


def is_one_row(cells: Collection[Cell]) -> bool:
    """Return whether the panels of `cells` are all beside each other."""
    return _columns(cells) >= len(cells)


def _columns(cells: Collection[Cell], widest: int = WIDEST) -> int:
    noises, tasks = {cell.noise for cell in cells}, {cell.task for cell in cells}
    full = len(cells) == len(tasks) * len(noises)
    if full and 1 < len(noises) <= widest:
        return len(noises)
    # As few rows as there can be, all as long as the first one or nearly so.
    rows = max(-(-len(cells) // widest), 1)
    return -(-len(cells) // rows)


def cell_panels(
    heights: Mapping[Cell, float], label: str, widest: int = WIDEST, **kwargs: bool
) -> tuple[Figure, dict[Cell, Any]]:
    """Return a figure with a panel for each cell, and its axes by cell.

    Args:
        heights: Of the panels in inches; a row is as high as its highest panel.
        label: What the x axes show; the lowest panels say it.
        widest: How many panels there are beside each other at most.
        **kwargs: As of `Figure.subplots`.
    """
    cells = sorted(heights)
    columns = _columns(cells, widest)
    lines = [cells[start : start + columns] for start in range(0, len(cells), columns)]
    figure, axes = style.panels(
        len(lines), columns, height=[max(heights[cell] for cell in line) for line in lines], **kwargs
    )
    found = dict(zip(cells, axes.flat, strict=False))
    for cell, axis in found.items():
        axis.set_title(cell.name, fontsize=style.TEXT)
    for axis in axes.flat[len(cells) :]:
        axis.remove()
    for axis in axes.flat[max(len(cells) - columns, 0) : len(cells)]:
        axis.tick_params(labelbottom=True)
        axis.set_xlabel(label if columns < WIDEST else label.partition(" (")[0])
    return figure, found
