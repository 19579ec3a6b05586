"""Which configuration of an algorithm bears the algorithm's name, where a cell has several."""

import json
from collections import defaultdict
from functools import cache
from typing import Any

import pandas as pd

from usbench.agents.zoo import ZOO, usual_envs
from usbench.records import TrialConfig
from usbench.records.configuration import digest
from usbench.results.tables import n_frames, senses
from usbench.tasks import PAPER, row_of
from usbench.words import network_apart

# In every comparison, beside the agents that learn; one trial of each is enough.
REFERENCE_POLICIES = tuple(name for name, row in ZOO.items() if not row.learns)
# Settings that a name spells out; a name with more of them has a digest in their place.
SPELLED = 2
# Defaults of the other settings, for trials whose record does not name them.
OPTIONS = {name: value for row in ZOO.values() for name, value in row.options.items()}
# Settings that are left out of a trial's row where they are so.
UNSAID = {"n_envs": 1, "senses": "none", **OPTIONS}


def named(trials: pd.DataFrame) -> pd.DataFrame:
    """Return the trials with a column `agent`: the row of the leaderboard to which each belongs.

    An agent is named after its algorithm. Where trials of an algorithm on one task have several settings, in
    one cell or with other noise, the settings that fill most cells keep the name. Of several such it is those
    that are most like what the command itself takes (steps, hyperparameters, frames, environments, senses),
    then those with most finished trials: whoever adds trials with other settings, however many, does not take
    the name. Other settings are named by what differs from these, for example
    "vpg gamma=0.9". Of settings that are equal in all this, none keeps the name. The paper's tasks count
    apart from others.
    """
    names = trials["algo"].copy()
    for (algo, _), own in trials.groupby([trials["algo"], trials["task"].isin(PAPER)]):
        kinds = _kinds(own)
        if len({*zip(own["task"], kinds, strict=True)}) > own["task"].nunique():
            names.update(_names(str(algo), own.assign(kind=kinds)))
    return trials.assign(agent=names)


def _kinds(own: pd.DataFrame) -> list[str]:
    """Return what trials have in common that differ in task, noise and seed alone.

    Configurations of two cells are never the same; their settings are. Of one cell, both should be.
    """
    kinds = [_kind(*one) for one in zip(own["settings"], own["steps"], strict=True)]
    within = list(zip(own["task"], own["noise"], kinds, strict=True))
    configurations = defaultdict(set)
    for place, configuration in zip(within, own["configuration"], strict=True):
        configurations[place].add(configuration)
    return [
        f"{place[-1]} {configuration}" if len(configurations[place]) > 1 else place[-1]
        for place, configuration in zip(within, own["configuration"], strict=True)
    ]


@cache
def _kind(settings: str, steps: int) -> str:
    return json.dumps(spelled(settings, steps), sort_keys=True)


def _names(algo: str, own: pd.DataFrame) -> pd.Series:
    """Return the names of an algorithm's trials."""
    own = own.assign(done=own["status"] == "finished")
    finished = own[own["done"]]
    filled = {
        kind: (len(rows[["task", "noise"]].drop_duplicates()), len(rows))
        for kind, rows in finished.groupby("kind")
    }
    names = pd.Series(algo, index=own.index)
    for _, of_task in own.groupby("task"):
        found = {kind: rows for kind, rows in of_task.groupby("kind")}
        rank = {
            kind: (filled.get(kind, (0, 0))[0], _alike(rows.iloc[0]), *filled.get(kind, (0, 0))[1:])
            for kind, rows in found.items()
        }
        first, *others = sorted(found, key=lambda kind: rank[kind], reverse=True)
        tied = [kind for kind in others if rank[kind] == rank[first]]
        beside = {kind: first for kind in others} | ({first: tied[0]} if tied else {})
        for kind, other in beside.items():
            rows = found[kind]
            names[rows.index] = f"{algo} {_difference(rows, found[other]) or rows['configuration'].iloc[0]}"
    return names


def _alike(trial: pd.Series) -> int:
    """Return how many settings of a trial are the usual ones: its steps, and what `is_usual` looks at."""
    whole = trial["steps"] == row_of(trial["task"]).steps
    return int(whole) + sum(_usual(trial))


def is_usual(trial: pd.Series) -> bool:
    """Return whether hyperparameters, frames, environments and senses are those of the command itself."""
    return all(_usual(trial))


def _usual(trial: pd.Series) -> tuple[bool, ...]:
    return not changed_hyperparameters(trial), has_frames(trial), has_envs(trial), has_senses(trial)


def has_frames(trial: pd.Series) -> bool:
    """Return whether the agent sees as many frames as the command takes by itself."""
    return n_frames(trial["settings"]) == TrialConfig.n_frames


def has_senses(trial: pd.Series) -> bool:
    """Return whether the agent is told what its task tells by itself."""
    return set(senses(trial["settings"])) == set(row_of(trial["task"]).senses)


def has_envs(trial: pd.Series) -> bool:
    """Return whether as many environments learn in step as the command takes by itself."""
    settings, row = json.loads(trial["settings"]), ZOO.get(network_apart(trial["algo"])[0])
    rollout = settings.get("n_steps", 0)
    if not isinstance(rollout, int):  # no trial of this package records that
        return False
    usual = 1 if row is None else usual_envs(row, int(trial["steps"]), rollout)
    return bool(settings.get("n_envs", 1) == usual)


def changed_hyperparameters(trial: pd.Series) -> dict[str, Any]:
    """Return the hyperparameters of a trial that are others than in the table of algorithms.

    One that the trial does not have is None. A network beside the paper's is part of the algorithm's name and
    has the same hyperparameters. Those of an algorithm of another package are what its class says.
    """
    row = ZOO.get(network_apart(trial["algo"])[0])
    if row is None:
        return {}
    settings = {**row.options, **json.loads(trial["settings"])}
    wanted = {**row.options, **row.hyperparameters, **row.tasks.get(trial["task"], {})}
    steps = row_of(trial["task"]).steps
    if "buffer_size" in wanted:  # as `configuration.resolve` fills it in
        wanted["buffer_size"] = max(wanted["buffer_size"], steps)
    return {name: settings.get(name) for name, value in wanted.items() if settings.get(name) != value}


def spelled(settings: str, steps: int) -> dict[str, Any]:
    """Return the settings of a trial and its steps, with those that stand in no table where they are so.

    That its agent explores is left out: it is known of finished trials alone.
    """
    own = UNSAID | json.loads(settings) | {"steps": int(steps)}
    return {key: value for key, value in own.items() if key != "explores"}


def _difference(rows: pd.DataFrame, others: pd.DataFrame) -> str:
    """Return the settings in which trials of one configuration differ from those of another, in words."""
    own, other = (spelled(each["settings"].iloc[0], each["steps"].iloc[0]) for each in (rows, others))
    differing = {key: own.get(key) for key in sorted({*own, *other}) if own.get(key) != other.get(key)}
    if len(differing) > SPELLED:
        return digest(differing)
    return ", ".join(f"{key}={value}" for key, value in differing.items())
