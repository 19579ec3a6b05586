"""Which configuration of an algorithm bears the algorithm's name, where a cell has several."""

import json

import pandas as pd

from usbench.agents.zoo import ZOO
from usbench.records import TrialConfig
from usbench.results.tables import digest, n_frames
from usbench.tasks import PAPER, row_of

# Settings that a name spells out; a name with more of them has a digest in their place.
SPELLED = 2


def named(trials: pd.DataFrame) -> pd.DataFrame:
    """Return the trials with a column `agent`: the row of the leaderboard to which each belongs.

    An agent is named after its algorithm. Where trials of an algorithm in one cell have several
    configurations, the one that fills most cells keeps the name. Of several such it is the one with the
    settings of the table of algorithms, then the one with most finished trials: whoever adds trials with
    other settings, however many, does not take the name. Other configurations are named by the settings in
    which they differ from it, for example "vpg gamma=0.9". Of configurations that are equal in all this,
    none keeps the name. The paper's tasks count apart from others.
    """
    names = trials["algo"].copy()
    for (algo, _), own in trials.groupby([trials["algo"], trials["task"].isin(PAPER)]):
        if (own.groupby(["task", "noise"])["configuration"].nunique() > 1).any():
            names.update(_names(str(algo), own))
    return trials.assign(agent=names)


def _names(algo: str, own: pd.DataFrame) -> pd.Series:
    """Return the names of an algorithm's trials."""
    # Configurations of two cells are never the same; their settings are.
    own = own.assign(kind=own["settings"] + own["steps"].map(" {}".format), done=own["status"] == "finished")
    finished = own[own["done"]]
    filled = {
        kind: (len(rows[["task", "noise"]].drop_duplicates()), len(rows))
        for kind, rows in finished.groupby("kind")
    }
    names = pd.Series(algo, index=own.index)
    for _, cell in own.groupby(["task", "noise"]):
        found = {name: rows for name, rows in cell.groupby("configuration")}
        rank = {}
        for name, rows in found.items():
            n_cells, n_trials = filled.get(rows["kind"].iloc[0], (0, 0))
            rank[name] = (n_cells, _alike(rows.iloc[0]), n_trials, rows["done"].sum())
        first, *others = sorted(found, key=lambda name: rank[name], reverse=True)
        tied = [name for name in others if rank[name] == rank[first]]
        for name in others:
            names[found[name].index] = f"{algo} {_difference(found[name], found[first]) or name}"
        if tied:
            names[found[first].index] = f"{algo} {_difference(found[first], found[tied[0]]) or first}"
    return names


def _alike(trial: pd.Series) -> int:
    """Return how many of hyperparameters, steps and frames are those of the table of algorithms.

    A network beside the paper's is part of the algorithm's name and has the same hyperparameters.
    """
    row = ZOO.get(trial["algo"].partition("+")[0])
    if row is None:
        return 0
    settings = json.loads(trial["settings"])
    wanted = {**row.hyperparameters, **row.tasks.get(trial["task"], {})}
    steps = row_of(trial["task"]).steps
    if "buffer_size" in wanted:  # as `configuration.resolve` fills it in
        wanted["buffer_size"] = max(wanted["buffer_size"], steps)
    same = all(settings.get(name) == value for name, value in wanted.items())
    as_usual = n_frames(trial["settings"]) == TrialConfig.n_frames
    whole = trial["steps"] == steps
    return int(same) + int(whole) + int(as_usual)


def _difference(rows: pd.DataFrame, others: pd.DataFrame) -> str:
    """Return the settings in which trials of one configuration differ from those of another, in words."""
    own, other = (
        json.loads(each["settings"].iloc[0]) | {"steps": each["steps"].iloc[0]} for each in (rows, others)
    )
    differing = {key: own.get(key) for key in sorted({*own, *other}) if own.get(key) != other.get(key)}
    if len(differing) > SPELLED:
        return digest(differing)
    return ", ".join(f"{key}={value}" for key, value in differing.items())
