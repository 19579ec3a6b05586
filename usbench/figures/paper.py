"""Figures 4 and 5 of the paper, for every algorithm: training episodes, mean and deviation over seeds.

Figure 4 shows the return; Figure 5 the distance from the object and the sine of the angle between the planes
(here at the end of the episode), and beside it the distance of the focal point, in mm, which is not in the
paper. The paper's upper axis counts policy updates: it stands over agents whose updates have as many steps.
"""

import json
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from usbench.figures import looks, style
from usbench.results.agents import named
from usbench.results.scores import value_based
from usbench.results.tables import TRAINING, TRAINING_PARTS, Results

# Steps per policy update in the paper's Table II; it draws its deviations after every 50 updates.
STEPS_PER_UPDATE = 64
BARS = 5
# Inches of a further line of a title, and of an axis of policy updates.
TITLE_LINE, UPDATES = 0.13, 0.36

# Task, column of the curves, title, label of the axis.
Column = tuple[str, str, str, str]
# An agent and what is shown of it.
Panel = tuple[str, Column]
FIGURE_4 = (
    ("fp", "return", "(a) focal point", "return per episode"),
    ("pp", "return", "(b) probe's plane", "return per episode"),
)
FIGURE_5 = (
    ("pp", "final_distance_mm", "(a) probe's plane: distance", "final distance (mm)"),
    ("pp", "abs_sin_angle", "(b) probe's plane: angle", "|sin(final angle)|"),
    ("fp", "final_distance_mm", "focal point: distance", "final distance (mm)"),
)


def figure4(known: Results) -> Figure | None:
    """Draw the return of training episodes against steps; None without any training."""
    return _draw(known, FIGURE_4)


def figure5(known: Results) -> Figure | None:
    """Draw final distance and sine of training episodes against steps; None without any training."""
    return _draw(known, FIGURE_5)


def _draw(known: Results, columns: tuple[Column, ...]) -> Figure | None:
    """Draw the panels of each agent beside each other, a line for each noise, bars of one deviation."""
    table = known.curves[known.curves["kind"] == TRAINING].merge(named(known.trials), on="trial")
    rows = _rows(table, columns)
    if not rows:
        return None
    figure, panels = _panels(rows)
    handles = _lines(panels, table)
    style.legend(figure, [handles[name] for name in sorted(handles)], sorted(handles))
    _head(figure, panels, _with_updates(table))
    return figure


def _rows(table: pd.DataFrame, columns: tuple[Column, ...]) -> list[list[Panel]]:
    """Return the panels that have something to show, a list for each line of the figure.

    Those of an agent stand beside each other, and no line has more than there are columns.
    """
    rows: list[list[Panel]] = []
    for agent, own in table.groupby("agent"):
        panels = [(str(agent), column) for column in columns if column[0] in set(own["task"])]
        if rows and len(rows[-1]) + len(panels) <= len(columns):
            rows[-1] += panels
        elif panels:
            rows.append(panels)
    return rows


def _panels(rows: list[list[Panel]]) -> tuple[Figure, dict[Panel, Any]]:
    """Return a figure with these panels alone, and its axes; the lowest of a column label training steps."""
    figure, axes = style.panels(len(rows), max(map(len, rows)), height=1.55, sharex=True)
    panels: dict[Panel, Any] = {}
    lowest: dict[int, Any] = {}
    for row, line in zip(rows, axes, strict=True):
        panels |= dict(zip(row, line, strict=False))
        lowest |= dict(enumerate(line[: len(row)]))
        for axis in line[len(row) :]:
            axis.remove()
    for axis in lowest.values():
        axis.set_xlabel("training steps")
        axis.tick_params(labelbottom=True)
        axis.locator_params(axis="x", nbins=4)
    return figure, panels


def _lines(panels: dict[Panel, Any], table: pd.DataFrame) -> dict[str, Any]:
    """Draw a line for each noise into all panels; return one of each by the words of the legend."""
    handles: dict[str, Any] = {}
    alike: dict[Column, Any] = {}
    for (agent, column), axis in panels.items():
        task, name, _, label = column
        own = table[(table["agent"] == agent) & (table["task"] == task)]
        for number, noise in enumerate(sorted(set(own["noise"]))):
            values = own[own["noise"] == noise].groupby("step")[name]
            handles[f"noise {noise:g}"] = _line(axis, values, number, looks.noise(noise))
        axis.set_ylabel(label, fontsize=style.SMALL)
        first = alike.setdefault(column, axis)
        if axis is not first:
            axis.sharey(first)
    return handles


def _with_updates(table: pd.DataFrame) -> set[tuple[str, str]]:
    """Return the agents and tasks of which every trial updates its policy after STEPS_PER_UPDATE steps.

    The `n_steps` of an agent that explores are those of its returns.
    """
    trials = table.drop_duplicates("trial")
    n_steps = trials["settings"].map(lambda text: json.loads(text).get("n_steps"))
    so = (n_steps == STEPS_PER_UPDATE) & ~value_based(trials)
    return {key for key, every in so.groupby([trials["agent"], trials["task"]]).all().items() if every}


def _head(figure: Figure, panels: dict[Panel, Any], with_updates: set[tuple[str, str]]) -> None:
    """Title all panels, in lines that are no wider than they, and add the axes of policy updates.

    The figure grows by what stands above its panels.
    """
    figure.draw_without_rendering()
    taken: dict[int, float] = {}
    for (agent, column), axis in panels.items():
        task, _, title, _ = column
        words = _title(agent, title, figure.get_figwidth() * axis.get_position().width)
        axis.set_title(words, fontsize=style.TEXT)
        high = TITLE_LINE * words.count("\n")
        if (agent, task) in with_updates:
            _label_updates(axis)
            high += UPDATES
        row = axis.get_subplotspec().rowspan.start
        taken[row] = max(high, taken.get(row, 0.0))
    # NumPy's numbers, as in `style.panels`.
    figure.set_figheight(figure.get_figheight() + sum(np.array([*taken.values()])))


def _title(agent: str, title: str, wide: float) -> str:
    """Return agent and title in one line if they fit into it, else each in lines of its own."""
    whole = f"{agent}: {title}"
    parts = [style.folded(part, wide, style.TEXT) for part in (f"{agent}:", title)]
    return whole if style.folded(whole, wide, style.TEXT) == whole else "\n".join(parts)


def _label_updates(axis: Any) -> None:
    """Label policy updates above a panel."""
    updates = axis.secondary_xaxis("top", functions=(_updates, lambda at: np.asarray(at) * STEPS_PER_UPDATE))
    updates.set_xlabel(f"policy updates of {STEPS_PER_UPDATE} steps", fontsize=style.SMALL)
    updates.tick_params(labelsize=style.SMALL)


def _line(axis: Any, values: Any, number: int, look: dict[str, Any]) -> Any:
    """Draw the mean over seeds, and its deviation five times, a little apart for each noise."""
    mean, deviation = values.mean(), values.std(ddof=1).fillna(0.0)
    every = TRAINING_PARTS // BARS
    bars = (every - 1 - number % every, every)
    return axis.errorbar(
        mean.index, mean, deviation, errorevery=bars, markevery=bars, capsize=2, ms=3.5, linewidth=1.2, **look
    )


def _updates(steps: Any) -> Any:
    return np.asarray(steps) / STEPS_PER_UPDATE
