"""The sections of the leaderboard that are about all cells together, as Markdown."""

from collections.abc import Collection, Mapping, Sequence

import numpy as np
import pandas as pd

from usbench.results import additions, ranking, scores, stats
from usbench.results.agents import named
from usbench.results.protocol import further
from usbench.results.tables import Results
from usbench.results.text import DASH, agent, bounds, capital, code, folded, interval, number, pairs_of, table

CELLS = "mean of the cells' IQMs"


def sections(
    own: Results,
    name: str,
    pairs: pd.DataFrame,
    doubted: Collection[str] = (),
    figures: Sequence[str] = (),
) -> list[str]:
    """Return the sections of one part of the results, each with its heading.

    Args:
        own: The results of the part.
        name: What the part is called, one of those of `scores.parts`.
        pairs: What `ranking.improvement` gives for its learning agents.
        doubted: Names of trials that are not verified.
        figures: Links to the pictures that stand in the section.
    """
    matrices, _ = scores.matrices(own)
    learners = scores.finals_of_learners(own)
    where = "" if name == scores.ALL else f": {name}"
    found = []
    if name in further.names():
        found += [f"## Further table: {name}", further.describe(name), *figures]
        found += [overall(own.trials, matrices, doubted, brief=True)] if learners else []
    elif matrices or figures:
        found += [f"## {capital(name)} together", *figures]
        found += [overall(own.trials, matrices, doubted)] if matrices else []
    if len(learners) > 1:
        n_seeds = {one: len(finals) for one, finals in learners.items()}
        found += [
            f"## Probability of improvement{where}",
            folded("Each agent beside each", improvement(n_seeds, pairs)),
        ]
    enough = {one: finals for one, finals in learners.items() if len(finals) >= ranking.MIN_SEEDS}
    if len(enough) > 1:
        found += [
            f"## Stability of ranks{where}",
            folded("Ranks without single cells and seeds", stability(enough)),
        ]
    return found


def overall(
    trials: pd.DataFrame,
    matrices: Mapping[str, stats.Array],
    doubted: Collection[str] = (),
    brief: bool = False,
) -> str:
    """Return the table of all cells together: those that are ranked first, then the others, best first.

    A `brief` one has no medians and means, and tells in a line what the whole one explains.
    """
    doubtful = additions.holders(trials, doubted)
    known = ranking.overall(matrices)
    notes = {
        one: scores.note(own["algo"].iloc[0], own["steps"].max())
        for one, own in named(trials).groupby("agent")
    }
    known = known.assign(note=known["agent"].map(notes))
    known["beside"] = known["note"] != ""
    known["asked"] = np.maximum(known["seeds"], np.where(known["beside"], 0, scores.seeds_asked(trials)))
    known = known.sort_values("beside", kind="stable")
    measures = {
        "cells": CELLS,
        **({} if brief else {"median": "median", "mean": "mean"}),
        "optimality_gap": "optimality gap",
    }
    rows = [
        [
            agent(row.agent, row.note, additions.MARK if row.agent in doubtful else ""),
            f"{row.seeds}/{row.asked}",
            interval(row.score, row.score_low, row.score_high),
            bounds(row.whole_low, row.whole_high),
            *(number(getattr(row, name), 3) for name in measures),
        ]
        for row in known.itertuples()
    ]
    n_cells = next(iter(matrices.values())).shape[1]
    title = "1 cell" if n_cells == 1 else f"{n_cells} cells (task and noise)"
    shown = table(["agent", "seeds", "score (IQM)", "with whole seeds", *measures.values()], rows)
    if brief:
        return f"Scores over {title}, of the seeds that are finished in all of them.\n\n{shown}"
    return (
        f"Scores over {title}, of the seeds that are finished in all of them. The score with its interval is "
        "the primary figure; seeds are resampled within each cell. For the interval with whole seeds, the "
        "same seeds are drawn for all cells, since a seed has the same starts in each."
        f"{_quarters(n_cells)}{_seeds(matrices)}\n\n{shown}"
    )


def _quarters(n_cells: int) -> str:
    """Return in words which cells the primary figure may leave out."""
    if n_cells == 1:
        return ""
    return (
        " The score leaves out the lowest and the highest quarter of an agent's scores in all cells "
        "together, so that a cell in which it always does badly, or always well, may not count at all; in "
        f"the {CELLS} every cell counts alike."
    )


def _seeds(matrices: Mapping[str, stats.Array]) -> str:
    """Return in words how much seeds matter for all cells alike: for all agents and for each."""
    common = ranking.common_to_seeds(matrices)
    if pd.isna(common):
        return ""
    each = pd.Series({name: ranking.common_to_seeds({name: matrix}) for name, matrix in matrices.items()})
    of_one = ""
    if each.notna().sum() > 1:
        # Nobody is named: of a single agent, this has no interval.
        of_one = f" ({_percent(each.min())} to {_percent(each.max())} for single agents)"
    return (
        f" Of the variance between trials of a cell, {_percent(common)} are common to all cells of a seed"
        f"{of_one}: where this is large, the interval by cells is too narrow, and agents are told apart too "
        "easily (docs/comparison.md)."
    )


def _percent(share: float) -> str:
    return f"{100 * max(share, 0.0):.0f} %"


def improvement(n_seeds: Mapping[str, int], pairs: pd.DataFrame) -> str:
    """Return the matrix of probabilities that a row's agent beats a column's, bold where that is sure."""
    sure = ranking.above(pairs)
    chances = pairs.set_index(["agent", "other"])["probability"]
    rows = []
    for one in n_seeds:
        cells = []
        for other in n_seeds:
            mark = "**" if {(one, other), (other, one)} & sure else ""
            cells.append(DASH if one == other else f"{mark}{number(chances[one, other], 2)}{mark}")
        rows.append([code(one), *cells])
    fewer = sorted(ranking.above_by_cells_alone(pairs))
    whole = f" With whole seeds drawn, it is not sure that {pairs_of(fewer)}." if fewer else ""
    n_sure = ranking.n_sure(n_seeds.values())
    level = ranking.corrected_level(n_sure)
    n_pairs = n_sure * (n_sure - 1) // 2
    many = "" if n_pairs == 1 else f", which is 1 - 0.05 / {n_pairs} for {n_pairs} pairs,"
    return (
        "How likely a trial of the row's agent has a higher score than one of the column's in a cell, ties "
        f"counting half; bold where the {100 * level:.4g} % interval{many} leaves out one half: there alone "
        f"one agent lies above the other ({ranking.N_RESAMPLES} resamples). Of agents with fewer than "
        f"{ranking.MIN_SEEDS} seeds nothing is bold, whatever the probability.{whole}\n\n"
        + table(["", *map(code, n_seeds)], rows)
    )


def stability(finals: Mapping[str, pd.DataFrame]) -> str:
    """Return the table of ranks, and what becomes of them when cells or seeds are left out."""
    rows = [
        [
            code(str(row.agent)),
            str(row.rank),
            _ranks(row.cells_best, row.cells_worst),
            _ranks(row.seeds_best, row.seeds_worst),
        ]
        for row in ranking.stability(finals).itertuples()
    ]
    return (
        "Ranks by the score, and the best and worst of them when any cell, or any two seeds, is left out.\n\n"
        + table(["agent", "rank", "without a cell", "without two seeds"], rows)
    )


def _ranks(best: float, worst: float) -> str:
    if pd.isna(best):
        return DASH
    return f"{best:.0f}" if best == worst else f"{best:.0f} to {worst:.0f}"
