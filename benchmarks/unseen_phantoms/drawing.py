"""Two figures of agents on unseen phantoms, from the CSV of trials alone."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from unseen_phantoms.studies import SETTING, TASK
from unseen_phantoms.trial_table import intervals
from usbench.ceilings import ceiling
from usbench.figures import looks, style
from usbench.figures.comparison import CEILING, OPTIMUM, SCORE
from usbench.figures.score_axis import HIGHEST

# What is drawn of each agent, and how the known phantoms differ from the unseen ones.
SCORES: dict[str, tuple[str, dict[str, Any]]] = {
    "unseen": ("unseen phantoms", {"linestyle": "-"}),
    "known": ("phantoms of the training", {"linestyle": ":", "fillstyle": "none"}),
}


def write(rows: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw the figures for which there are rows into a folder; return the files."""
    drawn = {"gap": gap, "scaling": scaling}
    tables = {name: rows[rows["table"] == name] for name in drawn}
    return [
        style.save(drawn[name](own), folder / f"unseen_{name}.png")
        for name, own in tables.items()
        if not own.empty
    ]


def gap(rows: pd.DataFrame) -> Figure:
    """Draw both scores over the number of training phantoms, of the trials with most steps."""
    points = intervals(rows[rows["steps"] == rows["steps"].max()])
    counts = points["phantoms"].to_numpy(np.float64, na_value=np.inf)
    names = ["no limit" if np.isinf(count) else _number(count) for count in counts]
    places = np.unique(counts, return_inverse=True)[1]
    return _figure(points.assign(at=places, name=names), "phantoms in training")


def scaling(rows: pd.DataFrame) -> Figure:
    """Draw both scores over training steps, whose axis is logarithmic."""
    points = intervals(rows)
    places = np.log10(points["steps"])
    return _figure(points.assign(at=places, name=points["steps"].map(_number)), "training steps")


def _number(count: float) -> str:
    return f"{count:,.0f}".replace(",", " ")


def _figure(points: pd.DataFrame, label: str) -> Figure:
    """Draw both scores with their intervals over the places `at`, which bear a `name`; a panel per agent."""
    agents = sorted(points["variant"].unique())
    figure, axes = style.panels(1, len(agents), height=2.6, sharex=True, sharey=True)
    ticks = points.drop_duplicates("at")
    for agent, axis in zip(agents, axes.flat, strict=True):
        _curves(axis, agent, points[points["variant"] == agent].sort_values("at"))
        axis.set_xticks(ticks["at"], ticks["name"])
        axis.set_title(agent, fontsize=style.TEXT)
        axis.set_xlabel(label)
    lowest = float(points[["known", "unseen", "known_low", "unseen_low"]].min(axis=None))
    axes[0, 0].set_ylim(min(0.0, lowest - 0.03), HIGHEST)
    figure.supylabel(SCORE, fontsize=style.TEXT)
    fewest, most = points["seeds"].min(), points["seeds"].max()
    seeds = f"{most} seeds" if fewest == most else f"{fewest} to {most} seeds"
    told = "a single seed" if most == 1 else f"IQM over {seeds} with 95 % bootstrap band"
    figure.suptitle(f"{TASK}, greedy actions: {told}", fontsize=style.TEXT)
    style.legend(figure, *axes[0, 0].get_legend_handles_labels())
    return figure


def _curves(axis: Any, agent: str, own: pd.DataFrame) -> None:
    look = looks.agents([agent])[agent]
    for score, (label, differs) in SCORES.items():
        axis.plot(own["at"], own[score], label=label, markersize=4.5, linewidth=1.2, **{**look, **differs})
        band = own[f"{score}_low"], own[f"{score}_high"]
        axis.fill_between(own["at"], *band, color=look["color"], alpha=0.15, linewidth=0)
    axis.axhline(1.0, label="optimum", zorder=1, **OPTIMUM)
    axis.axhline(
        ceiling(TASK, SETTING["senses"]), label="ceiling of what an agent is told", zorder=1, **CEILING
    )
