"""From the rows of trials to the rows of the leaderboard: one for each cell (task and noise) and algorithm.

Three rules. The last evaluation point counts. What is called the score is that of greedy actions, for every
algorithm: a value-based one has no other policy (its sampled actions are exploration), and whoever is guided
gets the best advice. Unfinished trials are counted, never averaged in.
"""

import json
from typing import NamedTuple

import numpy as np
import pandas as pd

from usbench.ceilings import taught
from usbench.records import EXPLORATION
from usbench.results import stats
from usbench.results.agents import named
from usbench.results.protocol import further, unseen
from usbench.results.tables import GREEDY, MEANS, SAMPLED, TRAINING, Results
from usbench.tasks import PAPER

SCORED = GREEDY


class Cell(NamedTuple):
    """A task and a noise: what one table of the leaderboard is about."""

    task: str
    noise: float

    @property
    def name(self) -> str:
        """What the cell is called, for example "fp, noise 0.25"."""
        return f"{self.task}, noise {self.noise:g}"


CELL = list(Cell._fields)
ROW = [*CELL, "algo", "configuration", "agent"]
# What cells are averaged over together.
ALL, PAPERS, OTHERS = "all cells", "the paper's tasks", "the other tasks"
# How a reason begins why an agent has no score over all cells.
NOT_IN = "no finished trial in"
_NO_SCORE = dict.fromkeys(("score", "score_low", "score_high"), np.nan)


def parts(results: Results) -> dict[str, Results]:
    """Return the results that are averaged together: those of the grid first, then each further table's.

    Of the grid, the paper's tasks and the others are apart where agents learned on both: the paper's question
    is about its own, and the tasks beside them need not have every algorithm and noise. A further table alone
    is treated as a grid.
    """
    found = further.split(results)
    if len(found) == 1:
        return _by_tasks(*found.values())
    grid = found.pop(further.GRID, None)
    return found if grid is None else _by_tasks(grid) | found


def prefix(part: str) -> str:
    """Return what the names of the figures of a part begin with: nothing for a part of the grid."""
    if part == OTHERS:
        return "other_"
    return f"{part}_" if part in further.names() else ""


def _by_tasks(results: Results) -> dict[str, Results]:
    learning = results.trials["steps"] > 0
    papers = results.trials["task"].isin(PAPER)
    if not (learning & papers).any() or not (learning & ~papers).any():
        return {ALL: results}
    return {PAPERS: results.of(results.trials[papers]), OTHERS: results.of(results.trials[~papers])}


def cells_of(trials: pd.DataFrame) -> list[Cell]:
    """Return the cells of trials, in order."""
    return sorted({Cell(*cell) for cell in trials[CELL].itertuples(index=False, name=None)})


def environments(trials: pd.DataFrame) -> pd.Series:
    """Return the digest of each trial's environment."""
    return trials["settings"].map(lambda text: json.loads(text).get("environment", ""))


def ranked(trials: pd.DataFrame) -> pd.Series:
    """Return which trials are of ranked agents: those that learn, except those of `ceilings.TAUGHT`."""
    return (trials["steps"] > 0) & (trials["algo"].map(taught) == "")


def note(algo: str, steps: int) -> str:
    """Return what is said of an agent that is not ranked; nothing of one that is."""
    return "not learned" if steps == 0 else taught(algo)


def value_based(trials: pd.DataFrame) -> pd.Series:
    """Return which trials are of agents whose sampled actions are exploration."""
    settings = trials["settings"].map(json.loads)
    return settings.map(lambda own: EXPLORATION in own or own.get("explores") is True).astype(bool)


def cells(results: Results) -> pd.DataFrame:
    """Return a row per table, task, noise, algorithm, configuration and kind of actions, without index.

    `table` is the grid or a further table. Beside names: `seeds` that are finished of
    `seeds_asked`; `score` (interquartile mean of the normalised score over seeds) with `score_low` and
    `score_high`, its 95 % interval (NaN for a single seed); the means over seeds of the columns
    `tables.MEANS`; `area_under_curve` of the score and `training_minutes`. A row without a finished trial
    holds NaN, and so do the sampled actions of value-based agents: those explore, and how much is a setting.
    """
    found = []
    for table, own in further.split(results).items():
        found.append(_cells(own))
        found[-1].insert(0, "table", table)
    return pd.concat(found, ignore_index=True)


def _cells(results: Results) -> pd.DataFrame:
    """Return the rows of one table."""
    asked = {
        task: seeds_asked(own.trials)
        for own in _by_tasks(results).values()
        for task in set(own.trials["task"])
    }
    curves = results.curves[results.curves["kind"] != TRAINING]
    curves = curves.merge(results.trials[["trial", "training_s"]], on="trial")
    rows = []
    for row, trials in named(results.trials).groupby(ROW):
        for kind in (GREEDY, SAMPLED):
            own = curves[curves["trial"].isin(trials["trial"]) & (curves["kind"] == kind)]
            if kind == SAMPLED and value_based(trials).any():
                own = own[:0]
            last = own.groupby("trial").tail(1)
            steps = int(trials["steps"].iloc[0])
            names = dict(zip(ROW, row, strict=True)) | {"actions": kind, "steps": steps}
            wanted = asked[row[0]] if ranked(trials).any() else 0
            seeds = {"seeds": len(last), "seeds_asked": max(len(trials), wanted)}
            rows.append(names | seeds | _numbers(own, last))
    columns = [*ROW, "actions", "steps", "seeds", "seeds_asked", *_numbers(curves[:0], curves[:0])]
    return pd.DataFrame(rows, columns=columns)


def last(results: Results) -> pd.DataFrame:
    """Return the last evaluation with greedy actions of every trial that has one, a row each."""
    return results.curves[results.curves["kind"] == SCORED].groupby("trial").tail(1)


def matrices(results: Results) -> tuple[dict[str, stats.Array], dict[str, str]]:
    """Return the final scores `(n_seeds, n_cells)` of the agents, and why others have none: see `finals`."""
    found, reasons = finals(results)
    return {agent: table.to_numpy(np.float64) for agent, table in found.items()}, reasons


def finals(results: Results) -> tuple[dict[str, pd.DataFrame], dict[str, str]]:
    """Return the final scores of the agents, a row per seed and a column per cell, and why others have none.

    Cells are those of agents that are ranked, in order. The seeds of an agent are those that are finished in
    all of them. There are none where the trials of a cell are from different environments.
    """
    trials = named(results.trials)
    several = environments(trials).groupby([trials[name] for name in CELL]).nunique()
    if (several > 1).any():
        where = Cell(*several[several > 1].index[0])
        return {}, {
            agent: f"trials of {where.name} are from different environments" for agent in set(trials["agent"])
        }
    own = trials[ranked(trials)]
    wanted = cells_of(own if len(own) else trials)
    final = trials.merge(last(results)[["trial", "normalized_score"]], on="trial")
    found: dict[str, pd.DataFrame] = {}
    reasons: dict[str, str] = {}
    for agent in sorted(set(trials["agent"])):
        table = final[final["agent"] == agent].pivot(index="seed", columns=CELL, values="normalized_score")
        table = table.reindex(columns=pd.MultiIndex.from_tuples(wanted, names=CELL))
        empty = [cell for cell in wanted if table[cell].isna().all()]
        table = table.dropna()
        if empty:
            reasons[agent] = f"{NOT_IN} {'; '.join(cell.name for cell in empty)}"
        elif table.empty:
            reasons[agent] = "no seed is finished in every cell"
        else:
            found[agent] = table
    return found, reasons


def learners(results: Results) -> dict[str, stats.Array]:
    """Return the matrices of the agents that are ranked."""
    return {agent: table.to_numpy(np.float64) for agent, table in finals_of_learners(results).items()}


def finals_of_learners(results: Results) -> dict[str, pd.DataFrame]:
    """Return the final scores of the agents that are ranked, as `finals` does."""
    trials = named(results.trials)
    own = set(trials.loc[ranked(trials), "agent"])
    return {agent: table for agent, table in finals(results)[0].items() if agent in own}


def learning_curves(results: Results) -> pd.DataFrame:
    """Return the `score` over seeds with its interval at every evaluation point, a row for each.

    `minutes` is the mean time of training up to there, if each step takes as long as any other: a trial
    records the time of all its training. Trainings only: an agent that does not learn has no curve.
    """
    table = results.curves[results.curves["kind"] == SCORED].merge(named(results.trials), on="trial")
    table = table.assign(minutes=table["training_s"] / 60 * table["step"] / table["steps"].clip(lower=1))
    keys = [*CELL, "agent", "step"]
    rows = []
    for row, own in table[table["steps"] > 0].groupby(keys):
        matrix = own["normalized_score"].to_numpy(np.float64)[:, np.newaxis]
        rows.append(dict(zip(keys, row, strict=True)) | {"minutes": own["minutes"].mean()} | score_of(matrix))
    return pd.DataFrame(rows, columns=[*keys, "minutes", *_NO_SCORE])


def seeds_asked(trials: pd.DataFrame) -> int:
    """Return how many seeds the ranked algorithms were to have, from all trials of their own rows.

    Of those with new phantoms and a budget for that, which are of no protocol, none was to have any: 0.
    """
    own = named(trials)
    own = own[[not unseen.has(*one) for one in zip(own["task"], own["steps"], strict=True)]]
    return int(own.loc[ranked(own) & (own["agent"] == own["algo"]), "seed"].nunique())


def _numbers(curves: pd.DataFrame, last: pd.DataFrame) -> dict[str, float]:
    """Return the numbers of a row from the evaluations of its trials, `last` being the final ones."""
    interval = score_of(last[["normalized_score"]].to_numpy(np.float64)) if len(last) else _NO_SCORE
    areas = [
        float(stats.area_under_curve(own["trained"], own["normalized_score"]))
        for _, own in curves.groupby("trial")
        if len(own) > 1
    ]
    return {
        **interval,
        **{name: float(last[name].mean()) for name in MEANS},
        "area_under_curve": float(np.mean(areas)) if areas else np.nan,
        "training_minutes": float(last["training_s"].mean() / 60),
    }


def score_of(matrix: stats.Array, whole_seeds: bool = False) -> dict[str, float]:
    """Return the IQM and its interval, seeds drawn for each cell or whole; a single seed has none."""
    generator = np.random.default_rng(stats.BOOTSTRAP_SEED)
    interval = stats.stratified_bootstrap(stats.iqm, matrix, generator=generator, whole_seeds=whole_seeds)
    low, high = (interval.low, interval.high) if len(matrix) > 1 else (np.nan, np.nan)
    return {"score": float(interval.estimate), "score_low": float(low), "score_high": float(high)}
