"""What one setting of a training changes, seed by seed: the frames of an observation, or the budget."""

import json

import numpy as np
import pandas as pd

from usbench.checks import unknown
from usbench.results.scores import score_of, value_based
from usbench.results.tables import GREEDY, SAMPLED, Results, n_frames

# With which of several values the others are compared.
_COMPARED_WITH = {"n_frames": max, "steps": min}


def changes(results: Results, varied: str) -> pd.DataFrame:
    """Return the final scores of algorithms that were trained with several values of one setting.

    Only trials count that differ in nothing else, with the seeds that all these values have.

    Args:
        results: Trials and curves, as of a leaderboard's tables.
        varied: The setting: "n_frames", where values are compared with the largest, or "steps", where they
            are compared with the smallest.

    Returns:
        A row per task, noise, algorithm and value of `varied`, with the columns `seeds` and the mean
        normalised score over them: `greedy` with greedy actions, `drawn` with sampled ones (NaN for
        value-based algorithms). `gain` is the interquartile mean of what greedy actions score more than with
        the value that is compared with and the same seed, `low` and `high` its 95 % bootstrap interval; NaN
        in the row of that value. Algorithms with one value in a cell have no row.

    Raises:
        ValueError: If `varied` is another setting.
    """
    if varied not in _COMPARED_WITH:
        raise unknown("varied", varied, _COMPARED_WITH)
    compared_with, final = _COMPARED_WITH[varied], _final(results, varied)
    rows = []
    for (task, noise, algo, _), own in final.groupby(["task", "noise", "algo", "rest"]):
        scores = own.pivot_table(index="seed", columns=[varied, "kind"], values="normalized_score")
        values = sorted(own[varied].unique())
        scores = scores.dropna(subset=[(value, GREEDY) for value in values])
        if len(values) > 1 and len(scores):
            cell = {"task": task, "noise": noise, "algo": algo, "seeds": len(scores)}
            rows += [cell | {varied: value} | _row(value, compared_with(values), scores) for value in values]
    columns = ["task", "noise", "algo", varied, "seeds", GREEDY, SAMPLED, "gain", "low", "high"]
    return pd.DataFrame(rows, columns=columns)


def _final(results: Results, varied: str) -> pd.DataFrame:
    """Return the last scores of trials that learned; `rest` is what they have beside `varied`, as JSON."""
    trials = results.trials[results.trials["steps"] > 0]
    trials = trials.assign(n_frames=trials["settings"].map(n_frames))
    rest = [
        json.dumps({**json.loads(own), "steps": int(steps), varied: None}, sort_keys=True)
        for own, steps in zip(trials["settings"], trials["steps"], strict=True)
    ]
    trials = trials.assign(rest=rest)
    last = results.curves[results.curves["kind"].isin((GREEDY, SAMPLED))].groupby(["trial", "kind"]).tail(1)
    last = last[(last["kind"] == GREEDY) | ~last["trial"].isin(trials["trial"][value_based(trials)])]
    return trials.merge(last, on="trial", suffixes=("", "_last"))


def _row(value: int, compared_with: int, scores: pd.DataFrame) -> dict[str, float]:
    """Return the numbers of a value's row from scores (n_seeds, values and kinds)."""
    means = {kind: scores.get((value, kind), pd.Series(dtype=float)).mean() for kind in (GREEDY, SAMPLED)}
    if value == compared_with:
        return means
    more = (scores[value, GREEDY] - scores[compared_with, GREEDY]).to_numpy(np.float64)
    found = score_of(more[:, np.newaxis])
    return means | {"gain": found["score"], "low": found["score_low"], "high": found["score_high"]}
