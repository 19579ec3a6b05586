"""The figures of a comparison, from results alone."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from usbench.figures import paper, style
from usbench.results import ranking, scores, stats
from usbench.results.agents import named
from usbench.results.scores import SCORED, Cell
from usbench.results.tables import Results

SCORE = "normalised score (0 random, 1 optimum)"
# What learning curves are drawn over, by the column of `scores.learning_curves`.
OVER = {"step": "training steps", "minutes": "minutes of CPU time in training"}
N_THRESHOLDS = 141
WIDEST = 3  # panels beside each other
Looks = Mapping[str, dict[str, Any]]
# Agents that do not learn.
FIXED = {"color": "0.5", "marker": "D"}
# Without caps, which would lengthen an interval.
BAR: dict[str, Any] = {"linewidth": 4, "solid_capstyle": "butt"}


def write(known: Results, folder: Path, formats: Sequence[str] = ("png",)) -> list[Path]:
    """Draw every figure for which there are results into `folder`, made if need be; return the paths.

    Raises:
        ValueError: If a format is not one of `style.FORMATS`.
    """
    folder.mkdir(parents=True, exist_ok=True)
    return [
        style.save(figure, folder / f"{name}.{kind}")
        for name, figure in draw(known).items()
        if figure is not None
        for kind in formats
    ]


def draw(known: Results) -> dict[str, Figure | None]:
    """Return every figure by its name, None where there are no results for one."""
    drawn = {}
    looks = styles(known)
    for part, own in scores.parts(known).items():
        prefix = "other_" if part == scores.OTHERS else ""
        drawn[f"{prefix}scores"] = final_scores(own, looks)
        curves = scores.learning_curves(own)
        drawn[f"{prefix}learning_curves"] = learning_curves(curves, looks)
        drawn[f"{prefix}learning_curves_cpu"] = learning_curves(curves, looks, over="minutes")
        drawn[f"{prefix}performance_profiles"] = performance_profiles(own, looks)
        drawn[f"{prefix}improvement"] = improvement(own)
    return drawn | {"figure4": paper.figure4(known), "figure5": paper.figure5(known)}


def styles(known: Results) -> Looks:
    """Return how every agent that learns is drawn, the same in all figures."""
    learning = known.trials[known.trials["steps"] > 0]
    return style.styles([*learning["algo"], *named(learning)["agent"]])


def final_scores(known: Results, looks: Looks) -> Figure | None:
    """Draw the score of every agent in every cell with its interval; small circles are its seeds."""
    last = known.curves[known.curves["kind"] == SCORED].groupby("trial").tail(1)
    table = last.merge(named(known.trials), on="trial")
    if table.empty:
        return None
    order = table.groupby("agent")["normalized_score"].median().sort_values(kind="stable")
    agents = list(order.index)
    figure, cells = _cell_panels(table, SCORE, height=0.5 + 0.28 * len(agents), sharex=True, sharey=True)
    for cell, axis in cells.items():
        own = table[(table["task"] == cell[0]) & (table["noise"] == cell[1])]
        for agent, rows in own.groupby("agent"):
            height = agents.index(str(agent))
            matrix = rows[["normalized_score"]].to_numpy(np.float64)
            interval = _bootstrap(matrix)
            look = looks.get(str(agent), FIXED)
            axis.plot(
                matrix[:, 0], np.full(len(matrix), height + 0.25), "o", color="0.4", fillstyle="none", ms=4
            )
            axis.plot([interval.low, interval.high], [height, height], color=look["color"], **BAR)
            axis.plot(interval.estimate, height, look["marker"], color=look["color"], markersize=7)
        for anchor, line in ((0, ":"), (1, "-.")):
            axis.axvline(anchor, color="black", linestyle=line, linewidth=1)
        axis.set_yticks(range(len(agents)), agents)
        axis.set_ylim(-0.5, len(agents) - 0.4)
    figure.suptitle("IQM over seeds with 95 % bootstrap interval;\ncircles are single seeds", fontsize=10)
    return figure


def learning_curves(table: pd.DataFrame, looks: Looks, over: str = "step") -> Figure | None:
    """Draw the score in every cell with its interval, over training steps or, for "minutes", CPU time.

    `table` is what `scores.learning_curves` gives.
    """
    if table.empty:
        return None
    figure, cells = _cell_panels(table, OVER[over], sharey=True)
    handles = {}
    for cell, axis in cells.items():
        own = table[(table["task"] == cell[0]) & (table["noise"] == cell[1])]
        for agent, rows in own.groupby("agent"):
            look = looks[str(agent)]
            handles[str(agent)] = axis.plot(rows[over], rows["score"], markersize=4, **look)[0]
            band = (rows["score_low"], rows["score_high"])
            axis.fill_between(rows[over], *band, color=look["color"], alpha=0.12, linewidth=0)
        for anchor, line in ((0, ":"), (1, "-.")):
            axis.axhline(anchor, color="black", linestyle=line, linewidth=1)
        axis.locator_params(axis="x", nbins=5)
    figure.supylabel(SCORE, fontsize=10)
    style.legend(figure, [handles[name] for name in sorted(handles)], sorted(handles))
    figure.suptitle(f"{SCORED} actions: IQM over seeds\nwith 95 % bootstrap band", fontsize=10)
    return figure


def performance_profiles(known: Results, looks: Looks) -> Figure | None:
    """Draw the share of trials, over all cells, that score more than a threshold."""
    matrices = scores.learners(known)
    if not matrices:
        return None
    cells = ", ".join(sorted(set(known.trials["task"])))
    figure, axes = style.panels(1, 1, width=6.5, height=3.6)
    axis = axes[0, 0]
    lowest, highest = min(m.min() for m in matrices.values()), max(m.max() for m in matrices.values())
    thresholds = np.linspace(min(0.0, lowest - 0.01), max(1.0, highest), N_THRESHOLDS)
    for algo, matrix in matrices.items():
        profile = stats.stratified_bootstrap(
            lambda stack: stats.performance_profile(stack, thresholds),
            matrix,
            generator=np.random.default_rng(scores.BOOTSTRAP_SEED),
        )
        look = looks[algo]
        axis.plot(thresholds, profile.estimate, label=algo, markevery=10, markersize=4, **look)
        axis.fill_between(thresholds, profile.low, profile.high, color=look["color"], alpha=0.12, linewidth=0)
    axis.set_xlabel(f"threshold of the {SCORE}")
    axis.set_ylabel("share of trials above it")
    axis.set_title(f"Performance profiles, 95 % bootstrap band\n{cells}", fontsize=10)
    style.legend(figure, *axis.get_legend_handles_labels())
    return figure


def improvement(known: Results) -> Figure | None:
    """Draw, for every pair of agents, how likely the better one beats the other in a cell."""
    matrices = scores.learners(known)
    if len(matrices) < 2:
        return None
    ranked = list(ranking.overall(matrices)["agent"])
    pairs = ranking.improvement(matrices)
    better = pairs["agent"].map(ranked.index) < pairs["other"].map(ranked.index)
    pairs = pairs[better].sort_values("probability", kind="stable")
    figure, axes = style.panels(1, 1, width=6.5, height=0.6 + 0.26 * len(pairs))
    axis = axes[0, 0]
    for height, pair in enumerate(pairs.itertuples()):
        axis.plot([pair.sure_low, pair.sure_high], [height, height], color=style.COLORS[0], linewidth=1)
        axis.plot([pair.low, pair.high], [height, height], color=style.COLORS[0], alpha=0.5, **BAR)
        sure = "none" if np.isnan(pair.low) else "full"
        axis.plot(pair.probability, height, "o", color="black", fillstyle=sure, markersize=5)
    axis.axvline(0.5, color="black", linestyle=":", linewidth=1)
    axis.set_yticks(range(len(pairs)), pairs["agent"] + " > " + pairs["other"])
    axis.set_xlim(-0.02, 1.02)
    hollow = " (hollow: one seed, none)" if pairs["low"].isna().any() else ""
    level = 100 * ranking.corrected_level(len(matrices))
    thin = f"\n(thin: {level:.4g} %, for all pairs together)" if pairs["sure_low"].notna().any() else ""
    axis.set_xlabel(f"probability of improvement, 95 % bootstrap interval{hollow}{thin}")
    return figure


def _cell_panels(
    table: pd.DataFrame, label: str, *, height: float = 2.6, **kwargs: bool
) -> tuple[Figure, Any]:
    """Return a figure with a panel for each task (rows) and noise (columns), and its axes by cell.

    Tasks of a single noise stand beside each other. The lowest panels have the `label`.
    """
    tasks, noises = sorted(set(table["task"])), sorted(set(table["noise"]))
    names = [(task, noise) for task in tasks for noise in noises]
    columns = len(noises) if len(noises) > 1 else min(len(names), WIDEST)
    rows = -(-len(names) // columns)
    figure, axes = style.panels(rows, columns, height=height, **kwargs)
    cells = dict(zip(names, axes.flat, strict=False))
    for name, axis in cells.items():
        axis.set_title(Cell(*name).name, fontsize=10)
    for axis in axes.flat[len(names) :]:
        axis.set_axis_off()
    for axis in axes.flat[max(len(names) - columns, 0) : len(names)]:
        axis.tick_params(labelbottom=True)
        axis.set_xlabel(label)
    return figure, cells


def _bootstrap(matrix: stats.Array) -> stats.Interval:
    return stats.stratified_bootstrap(
        stats.iqm, matrix, generator=np.random.default_rng(scores.BOOTSTRAP_SEED)
    )
