"""What is said about agents over all cells together: primary figure, who lies above whom, how firm ranks are.

docs/protocol.md named all of it before anything was trained.
"""

from collections.abc import Iterable, Iterator, Mapping
from itertools import combinations

import numpy as np
import pandas as pd

from usbench.results import stats
from usbench.results.scores import score_of

# With a level corrected for 28 pairs, an interval's ends are the 0.09 % at each side: 45 of these resamples.
N_RESAMPLES = 50_000
# Fewer seeds make no ranking: intervals of so few are much too narrow (benchmarks/intervals.py).
MIN_SEEDS = 5
# Of an agent's seeds that are left when two are left out.
MIN_LEFT = 2


def overall(scores: Mapping[str, stats.Array]) -> pd.DataFrame:
    """Return a row per agent, best first.

    Columns: `agent`, `seeds`; `score`, the primary figure (IQM over all cells), with `score_low` and
    `score_high`, seeds resampled within each cell; `whole_low` and `whole_high`, whole seeds resampled over
    all cells; `cells`, the mean of the IQMs of single cells; `median`, `mean` and `optimality_gap`.
    """
    rows = []
    for agent, matrix in scores.items():
        whole = score_of(matrix, whole_seeds=True)
        rows.append(
            {
                "agent": agent,
                "seeds": len(matrix),
                **score_of(matrix),
                "whole_low": whole["score_low"],
                "whole_high": whole["score_high"],
                "cells": float(np.mean([stats.iqm(cell[:, np.newaxis]) for cell in matrix.T])),
                "median": float(stats.median(matrix)),
                "mean": float(stats.mean(matrix)),
                "optimality_gap": float(stats.optimality_gap(matrix)),
            }
        )
    names = ("score", "score_low", "score_high", "whole_low", "whole_high", "cells", "median", "mean")
    table = pd.DataFrame(rows, columns=["agent", "seeds", *names, "optimality_gap"])
    return table.sort_values(["score", "agent"], ascending=[False, True], ignore_index=True)


def common_to_seeds(scores: Mapping[str, stats.Array]) -> float:
    """Return the share of the variance between trials of a cell that is common to all cells of a seed.

    The intraclass correlation (Shrout and Fleiss, Psychological Bulletin 86, 1979, case 3), pooled over
    agents, of scores that are standardised in each cell; cells in which all scores are equal do not count.
    NaN where there is one cell or one seed. It is an estimate, and below 0 where chance makes it so.
    """
    between, within, sizes = [], [], []
    for matrix in scores.values():
        differing = matrix[:, np.ptp(matrix, axis=0) > 0]
        rows = (differing - differing.mean(axis=0)) / differing.std(axis=0)
        n_seeds, n_cells = rows.shape
        if n_seeds < 2 or n_cells < 2:
            continue
        of_seed = rows.mean(axis=1, keepdims=True)
        between.append(n_cells * float((of_seed**2).sum()) / (n_seeds - 1))
        sizes.append(n_cells)
        within.append(float(((rows - of_seed) ** 2).sum()) / ((n_seeds - 1) * (n_cells - 1)))
    if not between:
        return float("nan")
    b, w = float(np.mean(between)), float(np.mean(within))
    return (b - w) / (b + (float(np.mean(sizes)) - 1) * w)


def corrected_level(n_agents: int) -> float:
    """Return the level of an interval that is one of as many as there are pairs (Bonferroni)."""
    return 1 - (1 - stats.LEVEL) / max(n_agents * (n_agents - 1) // 2, 1)


def n_sure(n_seeds: Iterable[int]) -> int:
    """Return between how many agents it can be sure that one lies above another.

    These are the agents with at least `MIN_SEEDS` seeds. Where fewer than two have so many, nothing is sure,
    and all of them count.
    """
    known = list(n_seeds)
    enough = sum(n >= MIN_SEEDS for n in known)
    return enough if enough > 1 else len(known)


def sure_level(n_seeds: Iterable[int]) -> float:
    """Return the level that is corrected for all pairs of agents of which it can be sure, see `n_sure`."""
    return corrected_level(n_sure(n_seeds))


def improvement(scores: Mapping[str, stats.Array]) -> pd.DataFrame:
    """Return a row per ordered pair.

    Columns: `agent`, `other`; `probability` that a trial of `agent` has a higher score than one of `other` in
    a cell; its 95 % interval `low`, `high`, which a single seed does not have; and `sure_low`, `sure_high`,
    the interval at the level of `sure_level`, for agents with at least `MIN_SEEDS` seeds;
    `whole_low`, `whole_high`, the same with whole seeds drawn over all cells.
    """
    level = sure_level(map(len, scores.values()))
    drawn: dict[tuple[int, int, int], list[list[stats.Array]]] = {}
    rows = []
    for agent, other in combinations(scores, 2):
        x, y = scores[agent], scores[other]
        sizes = (len(x), len(y), x.shape[1])
        if sizes not in drawn:
            # Afresh for each pair of sizes: a pair does not change when another agent is added.
            generator = np.random.default_rng(stats.BOOTSTRAP_SEED)
            drawn[sizes] = [
                [stats.draw_counts(n, x.shape[1], N_RESAMPLES, generator, whole) for n in sizes[:2]]
                for whole in (False, True)
            ]
        estimate = stats.probability_of_improvement(x, y)
        by_cell, whole = (stats.resampled_improvement(x, y, *counts) for counts in drawn[sizes])
        found = [
            stats.percentiles(estimate, resampled, each)
            for resampled, each in ((by_cell, stats.LEVEL), (by_cell, level), (whole, level))
        ]
        ends = np.array([end for interval in found for end in (interval.low, interval.high)])
        if min(sizes[:2]) == 1:
            ends[:] = np.nan
        if min(sizes[:2]) < MIN_SEEDS:
            ends[2:] = np.nan
        rows.append((agent, other, float(estimate), *ends))
        # The same resamples: what is sure one way round is sure the other.
        rows.append((other, agent, 1 - float(estimate), *(1 - ends[[1, 0, 3, 2, 5, 4]])))
    ends_of = [f"{name}{end}" for name in ("", "sure_", "whole_") for end in ("low", "high")]
    return pd.DataFrame(rows, columns=["agent", "other", "probability", *ends_of])


def above(pairs: pd.DataFrame) -> set[tuple[str, str]]:
    """Return the pairs of which the first lies above the second, the protocol's one rule for that.

    The corrected interval of the probability of improvement lies above one half.
    """
    return _pairs(pairs[pairs["sure_low"] > 0.5])


def above_by_cells_alone(pairs: pd.DataFrame) -> set[tuple[str, str]]:
    """Return those pairs of `above` that are not sure when whole seeds are drawn over all cells."""
    return _pairs(pairs[(pairs["sure_low"] > 0.5) & (pairs["whole_low"] <= 0.5)])


def _pairs(rows: pd.DataFrame) -> set[tuple[str, str]]:
    return set(rows[["agent", "other"]].itertuples(index=False, name=None))


def stability(finals: Mapping[str, pd.DataFrame]) -> pd.DataFrame:
    """Return how ranks by the primary figure change with what is left out, a row per agent, best first.

    Args:
        finals: Scores of each agent, a row per seed and a column per cell, as `scores.finals` gives them.

    Returns:
        The columns `agent` and `rank`; `cells_best` and `cells_worst`, the ranks when any cell is left out;
        `seeds_best` and `seeds_worst`, those when any two seeds are left out, for all agents together. NaN
        where there is nothing to leave out: one cell, or an agent with fewer than 4 seeds.
    """
    if not finals:
        return pd.DataFrame(
            columns=["agent", "rank", "cells_best", "cells_worst", "seeds_best", "seeds_worst"]
        )
    whole = _ranks(finals)
    table = pd.DataFrame({"agent": list(whole), "rank": list(whole.values())})
    for name, left in (("cells", _without_a_cell(finals)), ("seeds", _without_two_seeds(finals))):
        ranks = pd.DataFrame([_ranks(one) for one in left], columns=list(whole))
        table[f"{name}_best"] = ranks.min().to_numpy(float)
        table[f"{name}_worst"] = ranks.max().to_numpy(float)
    return table.sort_values("rank", ignore_index=True)


def _ranks(finals: Mapping[str, pd.DataFrame]) -> dict[str, int]:
    """Return the rank of each agent by the primary figure, from 1; equal ones go by name."""
    figures = {agent: float(stats.iqm(table.to_numpy(np.float64))) for agent, table in finals.items()}
    ordered = sorted(figures, key=lambda agent: (-figures[agent], agent))
    return {agent: ordered.index(agent) + 1 for agent in figures}


def _without_a_cell(finals: Mapping[str, pd.DataFrame]) -> Iterator[dict[str, pd.DataFrame]]:
    n_cells = next(iter(finals.values())).shape[1]
    for cell in range(n_cells if n_cells > 1 else 0):
        kept = [place for place in range(n_cells) if place != cell]
        yield {agent: table.iloc[:, kept] for agent, table in finals.items()}


def _without_two_seeds(finals: Mapping[str, pd.DataFrame]) -> Iterator[dict[str, pd.DataFrame]]:
    if min(len(table) for table in finals.values()) < 2 + MIN_LEFT:
        return
    for two in combinations(sorted({seed for table in finals.values() for seed in table.index}), 2):
        yield {agent: table[~table.index.isin(two)] for agent, table in finals.items()}
