"""The figures of a comparison, from results alone."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from usbench.ceilings import bound
from usbench.figures import looks, paper, score_axis, style
from usbench.figures.cells import WIDEST, cell_panels, is_one_row
from usbench.results import ranking, scores, stats, tables
from usbench.results.agents import REFERENCE_POLICIES, named
from usbench.results.protocol import further, unseen
from usbench.results.scores import SCORED, Cell
from usbench.results.tables import Results

SCORE = "normalised score (0 random, 1 optimum)"
# What learning curves are drawn over, by the column of `scores.learning_curves`.
OVER = {"step": "training steps", "minutes": "minutes of CPU time in training"}
N_THRESHOLDS = 141
# Thresholds from one marker of a profile to the next.
MARKED = 10
# Without caps, which would lengthen an interval.
BAR: dict[str, Any] = {"linewidth": 4, "solid_capstyle": "butt"}
# With a rim, by which it stands out from the bar or the curve of the same colour.
MEAN: dict[str, Any] = {"markersize": 6, "markeredgecolor": "white", "markeredgewidth": 0.6}
POINT: dict[str, Any] = {"markersize": 5, "markeredgecolor": "white", "markeredgewidth": 0.5}
# Height in inches of panels that are all in one row, so that the label of their axis fits beside them.
SINGLE_ROW = 3.2
# Inches of an agent's name beside a panel: in one line, names with settings would take the panel's place.
NAME_INCHES = 1.2
# Inches of a row of scores beside the lines of its name, and of each line.
ROW, NAME_LINE = 0.09, 0.1
# For which a panel of scores has room, so that a single marker fits in.
LEAST_ROWS = 3
# The figures of a part of the results, behind the part's prefix.
OF_A_PART = ("scores", "learning_curves", "learning_curves_cpu", "performance_profiles", "improvement")
OPTIMUM: dict[str, Any] = {"color": "black", "linestyle": "-.", "linewidth": 1}
ORACLE: dict[str, Any] = {"color": "0.5", "linestyle": "--", "linewidth": 1.2}
CEILING: dict[str, Any] = {"color": "#882255", "linestyle": ":", "linewidth": 1.6}


def write(known: Results, folder: Path, formats: Sequence[str] = ("png",)) -> list[Path]:
    """Draw every figure for which there are results into `folder`, made if need be; return the paths.

    A figure for which there are none is removed, if an earlier call drew it from other results.

    Raises:
        ValueError: If a format is not one of `style.FORMATS`.
    """
    folder.mkdir(parents=True, exist_ok=True)
    drawn = {name: figure for name, figure in draw(known).items() if figure is not None}
    for name in _possible() - drawn.keys():
        for kind in formats:
            (folder / f"{name}.{kind}").unlink(missing_ok=True)
    return [
        style.save(figure, folder / f"{name}.{kind}") for name, figure in drawn.items() for kind in formats
    ]


def _possible() -> set[str]:
    """Return the names of all figures that some results have."""
    prefixes = map(scores.prefix, (scores.ALL, scores.OTHERS, *further.names()))
    return {f"{prefix}{kind}" for prefix in prefixes for kind in OF_A_PART} | {"figure4", "figure5"}


def draw(known: Results) -> dict[str, Figure | None]:
    """Return every figure by its name, None where there are no results for one."""
    drawn = {}
    for part, own in scores.parts(known).items():
        prefix = scores.prefix(part)
        drawn[f"{prefix}scores"] = final_scores(own)
        curves = scores.learning_curves(own)
        drawn[f"{prefix}learning_curves"] = learning_curves(own, curves)
        drawn[f"{prefix}learning_curves_cpu"] = learning_curves(own, curves, over="minutes")
        if part == unseen.NAME:
            # Its cells have neither the same agents nor the same budget.
            continue
        drawn[f"{prefix}performance_profiles"] = performance_profiles(own)
        drawn[f"{prefix}improvement"] = improvement(own)
    first = further.first(known)
    return drawn | {"figure4": paper.figure4(first), "figure5": paper.figure5(first)}


def final_scores(known: Results) -> Figure | None:
    """Draw the score of every agent in every cell with its interval; small circles are its seeds."""
    table = _final(known)
    if table.empty:
        return None
    # Agents that do not learn are lines and anchors beside those that do, rows where there are no others.
    rows = table[~table["agent"].isin(REFERENCE_POLICIES)]
    rows = table if rows.empty else rows
    drawn = looks.agents(rows["agent"])
    worst_first = _ranked(known, rows)[::-1]
    here = {cell: [name for name in worst_first if name in set(own["agent"])] for cell, own in _by_cell(rows)}
    same = len({tuple(names) for names in here.values()}) == 1
    labels = {name: style.folded(name, NAME_INCHES, style.SMALL) for name in worst_first}
    row = ROW + NAME_LINE * max(1 + label.count("\n") for label in labels.values())
    figure, panels = cell_panels(
        {cell: 0.4 + row * max(len(names), LEAST_ROWS) for cell, names in here.items()},
        SCORE,
        # Names beside each panel leave room for two.
        widest=WIDEST if same else 2,
        sharex=True,
        sharey=same,
    )
    for cell, axis in panels.items():
        own = rows[(rows["task"] == cell.task) & (rows["noise"] == cell.noise)]
        for height, agent in enumerate(here[cell]):
            matrix = own.loc[own["agent"] == agent, ["normalized_score"]].to_numpy(np.float64)
            _score_row(axis, height, matrix, drawn[agent])
        _score_lines(axis.axvline, cell, table)
        axis.set_yticks(range(len(here[cell])), [labels[name] for name in here[cell]])
        axis.set_ylim(-0.5, len(here[cell]) - 0.3)
        axis.set_xlim(0, max(score_axis.HIGHEST, rows["normalized_score"].max() + 0.03))
    _line_legend(figure, list(panels), table)
    figure.suptitle(
        f"{_over_seeds(rows, 'interval; circles are single seeds')},\n"
        "an arrow and a number stand for what lies below 0",
        fontsize=style.TEXT,
    )
    return figure


def learning_curves(known: Results, table: pd.DataFrame, over: str = "step") -> Figure | None:
    """Draw the score in every cell with its interval, over training steps or, for "minutes", CPU time.

    `table` is what `scores.learning_curves` gives for `known`.
    """
    if table.empty:
        return None
    final = _final(known)
    cells = dict(_by_cell(table))
    height = SINGLE_ROW if is_one_row(cells) else 1.9
    figure, panels = cell_panels(dict.fromkeys(cells, height), OVER[over], sharey=True)
    drawn = looks.agents(table["agent"])
    handles = {}
    for cell, axis in panels.items():
        turns = looks.turns({name: drawn[name] for name in sorted(set(cells[cell]["agent"]))})
        for name, rows in cells[cell].groupby("agent"):
            agent = str(name)
            look = drawn[agent]
            (handles[agent],) = axis.plot(
                rows[over], rows["score"], linewidth=1.2, markevery=turns[agent], **POINT, **look
            )
            band = (rows["score_low"], rows["score_high"])
            axis.fill_between(rows[over], *band, color=look["color"], alpha=0.1, linewidth=0)
        score_axis.mark_below(
            axis,
            [
                (rows[over], rows["score"], drawn[str(name)]["color"])
                for name, rows in cells[cell].groupby("agent")
            ],
        )
        _score_lines(axis.axhline, cell, final)
        axis.set_ylim(0, max(score_axis.HIGHEST, table["score"].max() + 0.03))
        # Room for a number at step 0.
        axis.margins(x=0.08)
        axis.locator_params(axis="x", nbins=4)
    figure.supylabel(SCORE, fontsize=style.TEXT)
    ranked = _ranked(known, final[final["agent"].isin(set(handles))])
    _line_legend(figure, list(panels), final, {agent: handles[agent] for agent in ranked})
    figure.suptitle(
        f"{SCORED} actions: {_over_seeds(final[final['agent'].isin(set(handles))], 'band')};\n"
        "an arrow stands for a score below 0, a grey square for those of several agents, with their number",
        fontsize=style.TEXT,
    )
    return figure


def performance_profiles(known: Results) -> Figure | None:
    """Draw the share of trials, over all cells, that score more than a threshold."""
    matrices = scores.learners(known)
    if not matrices:
        return None
    cells = ", ".join(sorted(set(known.trials["task"])))
    figure, axes = style.panels(1, 1, height=3.0)
    axis = axes[0, 0]
    thresholds = np.linspace(0.0, max(1.0, *(m.max() for m in matrices.values())), N_THRESHOLDS)
    drawn = looks.agents(matrices)
    turns = looks.turns(drawn)
    for algo in ranking.overall(matrices)["agent"]:
        profile = stats.stratified_bootstrap(
            lambda stack: stats.performance_profile(stack, thresholds),
            matrices[algo],
            generator=np.random.default_rng(stats.BOOTSTRAP_SEED),
        )
        look = drawn[algo]
        place, of = turns[algo]
        every = (place * MARKED // of, MARKED)
        axis.plot(thresholds, profile.estimate, label=algo, markevery=every, **POINT, **look)
        axis.fill_between(thresholds, profile.low, profile.high, color=look["color"], alpha=0.1, linewidth=0)
    axis.set_xlim(0, thresholds[-1])
    axis.set_ylim(0, 1.03)
    axis.set_xlabel(f"threshold of the {SCORE}")
    axis.set_ylabel("share of trials above it")
    several = any(len(matrix) > 1 for matrix in matrices.values())
    band = "95 % bootstrap band" if several else "one seed each"
    axis.set_title(f"Performance profiles, {band}\n{cells}", fontsize=style.TEXT)
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
    figure, axes = style.panels(1, 1, height=0.3 + 0.19 * len(pairs))
    axis = axes[0, 0]
    for height, pair in enumerate(pairs.itertuples()):
        axis.plot([pair.sure_low, pair.sure_high], [height, height], color="0.4", linewidth=1)
        axis.plot([pair.low, pair.high], [height, height], color="0.7", **BAR)
        sure = "none" if np.isnan(pair.low) else "full"
        axis.plot(pair.probability, height, "o", color="black", fillstyle=sure, markersize=4)
    axis.axvline(0.5, color="black", linestyle=":", linewidth=1)
    axis.set_yticks(range(len(pairs)), "P(" + pairs["agent"] + " beats " + pairs["other"] + ")")
    axis.set_ylim(-0.7, len(pairs) - 0.3)
    axis.set_xlim(-0.02, 1.02)
    hollow = " (hollow: one seed, no interval)" if pairs["low"].isna().any() else ""
    level = 100 * ranking.sure_level(map(len, matrices.values()))
    thin = f"\n(thin: {level:.4g} %, for all pairs together)" if pairs["sure_low"].notna().any() else ""
    axis.set_xlabel(f"probability of improvement, 95 % bootstrap interval{hollow}{thin}")
    return figure


def _final(known: Results) -> pd.DataFrame:
    """Return a row for every finished trial: its last evaluation, its names."""
    return scores.last(known).merge(named(known.trials), on="trial")


def _over_seeds(final: pd.DataFrame, spread: str) -> str:
    """Return what the values of a figure are: with their `spread`, or of one seed each, which has none."""
    several = final.groupby(["agent", *scores.CELL]).size().max() > 1
    return f"IQM over seeds with 95 % bootstrap {spread}" if several else "one seed each, without intervals"


def _ranked(known: Results, final: pd.DataFrame) -> list[str]:
    """Return the agents of final scores, best first, in the order of the table over all cells.

    An agent that is not in that table has its place by the same figure, of all scores that it has.
    """
    matrices, _ = scores.matrices(known)
    found = {agent: own.to_numpy(np.float64) for agent, own in final.groupby("agent")[["normalized_score"]]}
    figures = {agent: float(stats.iqm(matrices.get(agent, own))) for agent, own in found.items()}
    return sorted(figures, key=lambda agent: (-figures[agent], agent))


def _by_cell(table: pd.DataFrame) -> list[tuple[Cell, pd.DataFrame]]:
    return [(Cell(*cell), own) for cell, own in table.groupby(scores.CELL)]


def _score_row(axis: Any, height: float, matrix: stats.Array, look: Mapping[str, Any]) -> None:
    """Draw the scores (n_seeds, 1) of an agent in a cell: its seeds, their interval, their mean."""
    interval = stats.stratified_bootstrap(
        stats.iqm, matrix, generator=np.random.default_rng(stats.BOOTSTRAP_SEED)
    )
    seeds = matrix[matrix >= 0]
    axis.plot(seeds, np.full(len(seeds), height + 0.28), "o", color="0.4", fillstyle="none", ms=3, mew=0.8)
    axis.plot([max(interval.low, 0), max(interval.high, 0)], [height, height], color=look["color"], **BAR)
    if interval.estimate >= 0:
        axis.plot(interval.estimate, height, marker=look["marker"], color=look["color"], **MEAN)
    lowest = min(float(matrix.min()), float(interval.estimate))
    score_axis.mark_lowest(axis, height, lowest, look["color"])


def _lines(cell: Cell, final: pd.DataFrame) -> dict[str, tuple[float, dict[str, Any]]]:
    """Return the scores of a cell that are lines, by the words of the legend.

    Where agents are told different things, the ceiling is that of those who are told most.
    """
    found = {"optimum": (1.0, OPTIMUM)}
    oracle = final[
        (final["agent"] == "oracle") & (final["task"] == cell.task) & (final["noise"] == cell.noise)
    ]
    if len(oracle):
        found["oracle in these episodes"] = (float(oracle["normalized_score"].mean()), ORACLE)
    here = final[(final["task"] == cell.task) & (final["noise"] == cell.noise) & (final["steps"] > 0)]
    told = {tables.senses(settings) for settings in here["settings"]}
    known = [one for one in (bound(cell.task, senses, cell.noise) for senses in told) if one is not None]
    if known:
        found["ceiling of what agents are told, or a bound of it"] = (max(known), CEILING)
    return found


def _score_lines(draw_line: Any, cell: Cell, final: pd.DataFrame) -> None:
    for value, look in _lines(cell, final).values():
        draw_line(value, zorder=1, **look)


def _line_legend(
    figure: Figure, cells: Sequence[Cell], final: pd.DataFrame, agents: Mapping[str, Any] | None = None
) -> None:
    """Draw the legend of the agents, then of the lines of all cells."""
    lines = {words: look for cell in cells for words, (_, look) in _lines(cell, final).items()}
    handles = dict(agents or {}) | {words: Line2D([], [], **look) for words, look in lines.items()}
    style.legend(figure, list(handles.values()), list(handles))
