"""Sentences on how episodes end: how often the agent misses the depth or turns the long way."""

from collections.abc import Mapping
from pathlib import Path

import pandas as pd

from paper_sentences.sentence import AGENT, FAILS, HOLDS, Sentence
from usbench.results import scores
from usbench.results.scores import Cell
from usbench.results.tables import GREEDY, Results
from usbench.results.text import table

# Shares of episodes by how they end, as benchmarks/failures.py keeps them.
ENDS = Path(__file__).parents[2] / "docs" / "ends.csv"
# Of all episodes, those that are "sometimes": one alone is not.
SOMETIMES = 0.01


def endings(known: Results, ends: pd.DataFrame) -> tuple[Sentence, Sentence]:
    """Return the two sentences on single episodes, from the shares that `episode_ends.shares` tells.

    Raises:
        ValueError: If the shares are not those of the trials of `known`.
    """
    own = ends[ends["algo"] == AGENT]
    _check_seeds(known, own)
    depth, plane = own[own["task"] == "fp"], own[own["task"] == "pp"]
    too_deep, misses = sometimes(known, depth, "too_deep")
    long_way, turns = sometimes(known, plane, "long_way")
    least = f"At least {100 * SOMETIMES:g} % of the episodes"
    return (
        Sentence(
            "In the FP task, the agent sometimes misses the target depth when moving the focal point from "
            "the top to the bottom",
            f"{least} end with the focus below the target, all of them having begun above it.",
            misses,
            f"{too_deep} "
            + episodes(depth, {"too deep (%)": depth["too_deep"], "too shallow (%)": depth["too_shallow"]}),
        ),
        Sentence(
            "In the PP task, the agent sometimes rotates the probe in a non-optimal direction (but still "
            "achieves the appropriate plane, due to the symmetry of the object)",
            f"{least} end in the object's plane after a rotation by more than a right angle. At half a turn "
            "from the object's angle it looks the same.",
            turns,
            f"{long_way} "
            + episodes(
                plane,
                {
                    "turn the long way (%)": plane["long_way"],
                    "end in plane (%)": 1 - plane["out_of_plane"],
                    "end at half a turn (%)": plane["half_turn"],
                },
            ),
        ),
    )


def sometimes(known: Results, ends: pd.DataFrame, kind: str) -> tuple[str, str]:
    """Return how many episodes of `known` in the cells of `ends` end so, and whether that is sometimes."""
    last = known.curves[known.curves["kind"] == GREEDY].sort_values("step").groupby("trial").tail(1)
    n_episodes = known.trials.merge(last, on="trial").groupby(scores.CELL)["episodes"].sum()
    counted = ends.set_index(scores.CELL)[kind]
    n_all = n_episodes.loc[counted.index]
    found = int((counted * n_all).round().sum())
    holds = HOLDS if found >= SOMETIMES * n_all.sum() else FAILS
    absent = [
        Cell(*cell).name for cell in n_episodes.index.difference(n_all.index) if cell[0] in set(ends["task"])
    ]
    apart = f" The single episodes of {', '.join(absent)} are not kept." if absent else ""
    return f"{found} of {n_all.sum()} episodes end so.{apart}", holds


def episodes(ends: pd.DataFrame, shares: Mapping[str, pd.Series]) -> str:
    """Return a table of the shares of episodes, a row per cell of `ends`."""
    rows = [
        [
            Cell(row.task, row.noise).name,
            str(row.seeds),
            *(f"{100 * share[row.Index]:.1f}" for share in shares.values()),
        ]
        for row in ends.itertuples()
    ]
    about = "Evaluation episodes after training, greedy actions ([how episodes end](failures.md))."
    return f"{about}\n\n{table(['cell', 'trials', *shares], rows)}"


def _check_seeds(known: Results, ends: pd.DataFrame) -> None:
    """Raise ValueError unless each row of `ends` is of as many trials as `known` has in its cell."""
    n_trials = known.trials.groupby(scores.CELL).size()
    for row in ends.itertuples():
        n_known = n_trials.get((row.task, row.noise), 0)
        if row.seeds != n_known:
            raise ValueError(
                f"the row of {row.algo} on {Cell(row.task, row.noise).name} in {ENDS.name} is of {row.seeds} "
                f"trials, and must be of all {n_known} of the leaderboard."
            )
