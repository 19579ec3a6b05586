"""Agents that were trained on one phantom, tested on unseen phantoms."""

import contextlib
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import pandas as pd
import torch

from usbench import records
from usbench.records import ConfigurationError
from usbench.results import held_out, scores, tables
from usbench.setting import Setting
from usbench.trials.evaluation import Evaluator
from usbench.trials.model_loading import load_agent
from usbench.waiting import Waiting

# Frames are told of every so many.
TOLD_FRAMES = 25


def untested(
    runs: Path,
    folder: Path,
    *,
    algos: Sequence[str] | None = None,
    tasks: Sequence[str] | None = None,
    noises: Sequence[float] | None = None,
    tell: Callable[[str], None] = lambda _: None,
) -> pd.DataFrame:
    """Return the rows of those of a comparison's trials in `runs` that `write` has to test.

    Args:
        runs: Where the comparison's trials are.
        folder: Where its tables are.
        algos: The algorithms to test; None for all but those from other modules, whose code would run.
        tasks: The tasks on one phantom whose agents are tested; None for all.
        noises: The noises of the trials; None for all.
        tell: Told what is left out.

    Raises:
        ConfigurationError: If there is no trial to test, or none of something that was asked for, or none of
            them is in `runs`.
        FileNotFoundError: If there are no tables, or no folder `runs`.
        ValueError: If the tables are broken.
    """
    records.existing(runs)
    trials = held_out.candidates(tables.read(folder))
    if trials.empty:
        raise ConfigurationError(
            f"{str(folder)!r} tells of no finished trial on {', '.join(held_out.MANY)}: run usbench compare."
        )
    asked = _asked(_asked(trials, "task", tasks), "noise", noises)
    asked = _without_own(asked, tell) if algos is None else _asked(asked, "algo", algos)
    missing = asked[~asked["trial"].isin(held_out.read(folder)["trial"])]
    there = missing["trial"].map(lambda name: (runs / name / records.TRIAL).is_file()).astype(bool)
    absent = list(missing.loc[~there, "trial"])
    if absent:
        told = f"{len(absent)} of {len(missing)} trials to test are not in {str(runs)!r}, as {absent[0]}"
        if len(absent) == len(missing):
            raise ConfigurationError(f"{told}: name the folder where they are.")
        tell(f"{told}: the others are tested")
    return missing[there]


def write(
    runs: Path, folder: Path, missing: pd.DataFrame, tell: Callable[[str], None] = lambda _: None
) -> list[str]:
    """Test trials, write `held_out.csv` after every test, so that none is lost, and return what failed.

    What another process writes there meanwhile stays.

    Args:
        runs: Where the trials are.
        folder: Where the comparison's tables are; tests of trials that these do not have are left out.
        missing: What `untested` returned.
        tell: Told how many frames there are, and which trial is tested.

    Returns:
        Why a trial cannot be tested, in a sentence for each that cannot; the others are tested.
    """
    results = tables.read(folder)
    held_out.keep(folder, held_out.candidates(results)["trial"].tolist())
    score_of = scores.last(results).set_index("trial")["normalized_score"]
    torch.set_num_threads(1)  # as in training: the bits do not depend on the machine
    for task in dict.fromkeys(missing["task"].map(held_out.MANY)):
        tell(f"frames of {task}")
        Setting(task=task).prepare_frames(partial(_tell_frames, tell))
    failures = []
    waiting = Waiting("Testing agents on unseen phantoms", len(missing))
    for number, (name, algo) in enumerate(missing[["trial", "algo"]].itertuples(index=False, name=None), 1):
        tell(f"trial {number} of {len(missing)}: {name}")
        try:
            row = test(runs / name, algo, float(score_of[name]))
        except ValueError as error:
            tell(str(error))
            failures.append(str(error))
        else:
            held_out.add(row, folder)
        waiting.done()
    return failures


def _asked(trials: pd.DataFrame, column: str, allowed: Sequence[object] | None) -> pd.DataFrame:
    """Return the trials that have one of the allowed values in a column; all for None."""
    if allowed is None:
        return trials
    there = list(dict.fromkeys(trials[column].sort_values()))
    for value in allowed:
        if value not in there:
            raise ConfigurationError(
                f"there is no such trial to test with {column} {value!r}, only with "
                f"{', '.join(map(repr, there))}."
            )
    return trials[trials[column].isin(allowed)]


def _without_own(trials: pd.DataFrame, tell: Callable[[str], None]) -> pd.DataFrame:
    """Return the trials without those of algorithms from other modules."""
    own = trials["algo"].str.contains(":")
    if own.any():
        names = " ".join(sorted(set(trials.loc[own, "algo"])))
        tell(f"left out, as testing them runs their code, unless they are named: {names}")
    return trials[~own]


def test(trial: Path, algo: str, score: float) -> dict[str, object]:
    """Play the evaluation episodes of the task on many phantoms with a trial's greedy actions.

    Raises:
        ConfigurationError: If its model cannot be opened, or its final score is not `score`, that of the
            tables.
    """
    loaded = load_agent(trial, algo=algo)
    own = records.Trial.read(trial).final_score()
    if abs(own - score) > 10**-tables.DECIMALS:
        raise ConfigurationError(
            f"{trial.name} has the score {own:.5f} in {str(trial.parent)!r} and {score:.5f} in the tables: "
            "it is another agent."
        )
    config = loaded.config
    many = held_out.MANY[config.task]
    senses = Setting.recorded(config).senses
    setting = Setting(task=many, noise=config.noise, n_frames=config.n_frames, senses=senses)
    with contextlib.closing(Evaluator(setting, setting.evaluation_episodes())) as evaluator:
        played = evaluator.play(loaded.agent, checkpoint=config.steps, step=config.steps, deterministic=True)
    table = pd.DataFrame([episode.as_row() for episode in played])
    return held_out.summary(trial.name, setting.task, table, setting.anchors())


def _tell_frames(tell: Callable[[str], None], done: int, total: int) -> None:
    """Tell how many frames there are, every now and then."""
    if done % TOLD_FRAMES == 0 or done == total:
        tell(f"simulating frames: {done} of {total}")
