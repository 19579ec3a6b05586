"""From folders of trials to the trained agents that come with the package: which, and what of each trial."""

import shutil
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from stable_baselines3.common.policies import BasePolicy

from usbench import records, released
from usbench.agents.zoo import ZOO
from usbench.atomic import move_whole, scratch_folder
from usbench.ceilings import taught
from usbench.compare import model_card
from usbench.compare.model_card import OWN
from usbench.own_task import is_on_its_task
from usbench.records import ConfigurationError, Trial, checksums
from usbench.suite import PAPER
from usbench.trials.model_loading import TARGET, load_agent, twin_of

DECIMALS = 6


def write(
    runs: Sequence[Path], folder: Path = released.FOLDER, tell: Callable[[str], None] = lambda _: None
) -> list[Path]:
    """Write the released agents that are chosen from the trials in `runs` again; return their folders.

    The same trials give the same bytes.

    Args:
        runs: Folders of trials, or single trials.
        folder: Where the agents are written, each into a folder. Of those that were there, agents of the same
            tasks are removed and agents of other tasks stay.
        tell: Told which trial becomes which agent.

    Raises:
        ConfigurationError: If no trial can be released, or a model cannot be opened.
        FileNotFoundError: If one of `runs` is no folder.
        ValueError: If a record is damaged.
    """
    trials = [trial for path in runs for trial in records.load_trials(path) if _can_be_released(trial)]
    if not trials:
        raise ConfigurationError(
            f"there is no finished trial to release in {', '.join(repr(str(path)) for path in runs)}: it "
            "must be of an algorithm of this package, on its task as it is, without noise."
        )
    tasks = {trial.config.task for trial in trials}
    there = [card.parent for card in folder.glob(f"*/{released.CARD}")]
    before = [path for path in there if Trial.read(path).config.task in tasks]
    made = []
    for name, trial in chosen(trials).items():
        tell(f"{name}: {trial.name}")
        rivals = [one for one in trials if one.config.task == trial.config.task]
        if name.startswith(f"{OWN}:"):
            rivals = [one for one in rivals if one.config.algo == OWN]
        elif not taught(trial.config.algo):
            rivals = [one for one in rivals if not taught(one.config.algo)]
        made.append(_write(trial, folder / name.replace(":", "-", 1), name, rivals))
    for path in before:
        if path not in made:
            shutil.rmtree(path)
    return made


def chosen(trials: Sequence[Trial]) -> dict[str, Trial]:
    """Return the trial of each released agent by its name: the best of each task, and the paper's agent.

    An agent that was told the truth while it learned is the best only where there is no other.
    """
    ranked = sorted(
        trials,
        key=lambda one: (taught(one.config.algo) != "", -_score(one), one.config.seed, one.name),
    )
    found: dict[str, Trial] = {}
    for trial in ranked:
        found.setdefault(f"best:{trial.config.task}", trial)
        if trial.config.algo == OWN and trial.config.task in PAPER:
            found.setdefault(f"{OWN}:{trial.config.task}", trial)
    return dict(sorted(found.items()))


def _can_be_released(trial: Trial) -> bool:
    """Return whether it is finished, of this package's algorithms, and on its task as it is."""
    config = trial.config
    if trial.status != "finished" or config.noise or config.algo not in ZOO or not config.steps:
        return False
    return is_on_its_task(config)


def _score(trial: Trial) -> float:
    """Return the mean score of its last evaluation with greedy actions, as precise as scores are compared."""
    return round(trial.final_score(), DECIMALS)


def _arrays(policy: BasePolicy) -> dict[str, Any]:
    """Return the weights with which a policy acts greedily; `load_agent` makes copies for those left out.

    A value network and its target network have the same names for the same weights. Only training needs
    both.
    """
    weights = {name: tensor.numpy() for name, tensor in policy.state_dict().items()}
    target_acts = getattr(policy, "greedy_net", None) is getattr(policy, "q_net_target", policy)
    return {
        name: array
        for name, array in weights.items()
        if twin_of(name) not in weights or name.partition(".")[0].endswith(TARGET) == target_acts
    }


def _write(trial: Trial, folder: Path, name: str, same: Sequence[Trial]) -> Path:
    """Write the released agent of a trial into `folder`; `same` are those among which it was chosen."""
    arrays = _arrays(load_agent(trial.folder).agent.policy)
    lines = (trial.folder / records.EVALUATIONS).read_text().splitlines(keepends=True)
    rivals = [model_card.Rival(one.name, one.config.algo, one.config.seed, _score(one)) for one in same]
    folder.parent.mkdir(parents=True, exist_ok=True)
    with scratch_folder(folder) as scratch:
        made = scratch / folder.name
        made.mkdir()
        np.savez(made / records.WEIGHTS, **arrays)
        last = f'"checkpoint": {trial.config.steps}, '
        (made / records.EVALUATIONS).write_bytes("".join(line for line in lines if last in line).encode())
        # The machine says nothing of the agent.
        sums = checksums.of(made, (records.EVALUATIONS, records.WEIGHTS))
        weights = sums.pop(records.WEIGHTS)
        replace(trial, folder=made, platform="", checksums=sums).write()
        (made / released.CARD).write_bytes(model_card.text(trial, name, rivals, weights).encode())
        move_whole(made, folder)
    return folder
