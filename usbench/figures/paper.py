"""Figures 4 and 5 of the paper, for every algorithm: training episodes, mean and deviation over seeds.

Figure 4 shows the return; Figure 5 the distance from the object and the sine of the angle between the planes
(here at the end of the episode), and beside it the distance of the focal point, in mm.
"""

import textwrap
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from usbench.figures import looks, style
from usbench.results.agents import named
from usbench.results.tables import TRAINING, TRAINING_PARTS, Results

# Steps per policy update in the paper's Table II; it draws its deviations after every 50 updates.
STEPS_PER_UPDATE = 64
BARS = 5
# For which the narrowest panel has room in a line of its title.
TITLE_LETTERS = 42

# Task, column of the curves, title, label of the axis.
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


def _draw(known: Results, columns: tuple[tuple[str, str, str, str], ...]) -> Figure | None:
    """Draw a row of panels for each agent, a line for each noise, bars of one standard deviation."""
    table = known.curves[known.curves["kind"] == TRAINING].merge(named(known.trials), on="trial")
    columns = tuple(column for column in columns if column[0] in set(table["task"]))
    if not columns:
        return None
    agents = sorted(set(table["agent"]))
    figure, axes = style.panels(len(agents), len(columns), height=1.55, sharex=True, sharey="col")
    handles = {}
    for panels, (task, name, title, label) in zip(axes.T, columns, strict=True):
        drawn = []
        for axis, agent in zip(panels, agents, strict=True):
            own = table[(table["agent"] == agent) & (table["task"] == task)]
            if own.empty:
                axis.set_axis_off()
                continue
            drawn.append(axis)
            for number, noise in enumerate(sorted(set(own["noise"]))):
                values = own[own["noise"] == noise].groupby("step")[name]
                handles[f"noise {noise:g}"] = _line(axis, values, number, looks.noise(noise))
            axis.set_title(textwrap.fill(f"{agent}: {title}", TITLE_LETTERS), fontsize=style.TEXT)
            axis.set_ylabel(label, fontsize=style.SMALL)
        _label_steps(drawn[0], drawn[-1])
    style.legend(figure, [handles[name] for name in sorted(handles)], sorted(handles))
    return figure


def _label_steps(first: Any, last: Any) -> None:
    """Label the steps of a column of panels: policy updates above the first, training below the last."""
    last.set_xlabel("training steps")
    last.tick_params(labelbottom=True)
    last.locator_params(axis="x", nbins=4)
    updates = first.secondary_xaxis("top", functions=(_updates, lambda at: np.asarray(at) * STEPS_PER_UPDATE))
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
