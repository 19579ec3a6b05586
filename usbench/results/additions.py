"""Trials that are added to the tables of a leaderboard: which may be, and what becomes of known ones."""

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from usbench import seed_pools
from usbench.atomic import atomic_file
from usbench.checks import ConfigurationError
from usbench.results import agents, scores
from usbench.results.protocol import further
from usbench.results.tables import ORDER, Results
from usbench.results.text import code

# Names of trials whose evaluations were played again and came out otherwise, or which could not be checked.
UNVERIFIED = "unverified.txt"
MARK = "not verified"


@dataclass(frozen=True)
class Difference:
    """A finished trial of the tables that was added with other numbers.

    Attributes:
        trial: Its name in the tables.
        known: Its final score there.
        added: The final score of the added one.
    """

    trial: str
    known: float
    added: float


@dataclass(frozen=True)
class Addition:
    """What came of adding trials.

    Attributes:
        results: The trials of both.
        same: Names of finished trials that the tables had already, with the same numbers.
        other: Those that the tables had with other numbers.
        new: Names of the added finished trials that the tables did not have, or that replace theirs.
        apart: Names of added trials whose configuration is not that of their algorithm's row, with the name
            of the row that they are in.
    """

    results: Results
    same: list[str]
    other: list[Difference]
    new: list[str]
    apart: dict[str, str]


def add(known: Results, added: Results, *, replace: bool = False) -> Addition:
    """Return the trials of both, and what there is to tell.

    A finished trial of the tables stays. With `replace`, an added one takes its place that is finished and
    has other numbers: that a trial was repeated changes nothing.

    Raises:
        ConfigurationError: If a trial that is new has a seed that is not kept for comparisons, or the name
            of another trial.
    """
    _check_seeds(_others(added, known.trials).trials)
    same, other = repeated(known, added)
    kept = [*same, *(() if replace else (one.trial for one in other))]
    rest = _others(added, known.trials[known.trials["trial"].isin(kept)])
    results = joined(known, rest)
    check_names(results.trials)
    own = _named(results.trials)
    own = own[own["trial"].isin(added.trials["trial"]) & (own["agent"] != own["algo"])]
    new = list(rest.trials.loc[rest.trials["status"] == "finished", "trial"])
    return Addition(results, same, other, new, dict(zip(own["trial"], own["agent"], strict=True)))


def joined(known: Results, added: Results) -> Results:
    """Return the trials of both; of one that both have the `added` one, if it is finished."""
    kept = _others(known, added.trials[added.trials["status"] == "finished"])
    new = _others(added, kept.trials)
    trials = pd.concat([kept.trials, new.trials]).sort_values(ORDER, ignore_index=True)
    place = {name: number for number, name in enumerate(trials["trial"])}
    curves = pd.concat([kept.curves, new.curves])
    curves = curves.sort_values("trial", key=lambda names: names.map(place), kind="stable", ignore_index=True)
    return Results(trials, curves)


def repeated(known: Results, added: Results) -> tuple[list[str], list[Difference]]:
    """Return the finished trials of both: names of those with the same numbers, and those with others."""
    both = known.trials.merge(added.trials, on=[*ORDER, "status"], suffixes=("", "_added"))
    both = both[both["status"] == "finished"]
    same: list[str] = []
    other: list[Difference] = []
    final = [scores.last(each).set_index("trial")["normalized_score"] for each in (known, added)]
    curves = [dict(list(each.curves.groupby("trial"))) for each in (known, added)]
    for names in both[["trial", "trial_added"]].itertuples(index=False, name=None):
        name, name_added = names
        one, two = (
            own[trial].drop(columns="trial").reset_index(drop=True)
            for own, trial in zip(curves, names, strict=True)
        )
        if one.equals(two):
            same.append(name)
        else:
            other.append(Difference(name, float(final[0][name]), float(final[1][name_added])))
    return same, other


def _others(known: Results, trials: pd.DataFrame) -> Results:
    """Return the results of all trials but `trials`."""
    own, left_out = (pd.MultiIndex.from_frame(table[ORDER]) for table in (known.trials, trials))
    return known.of(known.trials[~own.isin(left_out)])


def _named(trials: pd.DataFrame) -> pd.DataFrame:
    """Return the trials with the row of each table to which they belong."""
    return pd.concat([agents.named(own) for own in further.tables_of(trials).values()])


def _check_seeds(new: pd.DataFrame) -> None:
    """Raise ConfigurationError unless every trial that learned has a seed that is kept for comparisons."""
    for trial, seed in new.loc[new["steps"] > 0, ["trial", "seed"]].itertuples(index=False, name=None):
        try:
            seed_pools.own().check("comparison", int(seed))
        except ConfigurationError as error:
            raise ConfigurationError(f"{trial} cannot be added: {error}") from None


def check_names(trials: pd.DataFrame) -> None:
    """Raise ConfigurationError if two trials have one name."""
    for name in trials.loc[trials["trial"].duplicated(), "trial"]:
        raise ConfigurationError(
            f"{name} is the name of two trials with different settings: rename the folder of one."
        )


def unverified(folder: Path) -> list[str]:
    """Return the names of the trials of the tables in `folder` that are not verified."""
    path = folder / UNVERIFIED
    return path.read_text(encoding="utf-8").splitlines() if path.is_file() else []


def mark_unverified(folder: Path, checked: Collection[str], wrong: Collection[str]) -> None:
    """Keep in `folder` that of the trials `checked` those in `wrong` are not verified, and the others are."""
    names = sorted({*unverified(folder)} - {*checked} | {*wrong})
    if names or (folder / UNVERIFIED).exists():
        with atomic_file(folder / UNVERIFIED) as file:
            file.write("".join(f"{name}\n" for name in names).encode())


def holders(trials: pd.DataFrame, names: Collection[str]) -> set[str]:
    """Return those rows of a table, with these trials, that hold one of the trials `names`."""
    if not names:
        return set()
    own = agents.named(trials)
    return set(own.loc[own["trial"].isin(names), "agent"])


def meaning(names: Collection[str]) -> str:
    """Return in a sentence what it means that the trials `names` are not verified."""
    return (
        f"Rows that are {MARK} hold trials whose recorded actions do not give their recorded returns, or "
        f"which could not be checked (`usbench submit`): {', '.join(map(code, sorted(names)))}."
    )
