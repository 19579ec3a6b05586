"""Agents that were trained on one phantom, tested on phantoms that they have never seen."""

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

import pandas as pd
import torch

from usbench import held_out, results, runner, suite
from usbench.evaluation import Evaluator
from usbench.models import load_agent
from usbench.records import ConfigurationError


def write(runs: Path, folder: Path, tell: Callable[[str], None] = lambda _: None) -> Path:
    """Test the agents of a comparison that have not been tested, and write `held_out.csv`; return its path.

    Args:
        runs: Where the comparison's trials are.
        folder: Where its tables are.
        tell: Told which trial is tested.

    Raises:
        ConfigurationError: If there is nothing to test, or a model cannot be opened.
        FileNotFoundError: If there are no tables.
        ValueError: If they are broken.
    """
    trials = held_out.candidates(results.read(folder))
    if trials.empty:
        tasks = ", ".join(held_out.MANY)
        raise ConfigurationError(
            f"{str(folder)!r} tells of no finished trial on {tasks}: run usbench compare."
        )
    known = held_out.read(folder)
    rows = known[known["trial"].isin(trials["trial"])].to_dict("records")
    missing = trials[~trials["trial"].isin(known["trial"])]
    torch.set_num_threads(1)  # as in training: the bits do not depend on the machine
    for task in dict.fromkeys(missing["task"].map(held_out.MANY)):
        tell(f"frames of {task}")
        runner.prepare_frames(task)
    for number, trial in enumerate(missing["trial"], 1):
        tell(f"trial {number} of {len(missing)}: {trial}")
        rows.append(test(runs / trial))
    return held_out.write(pd.DataFrame(rows, columns=list(held_out.COLUMNS)), folder)


def test(trial: Path) -> dict[str, object]:
    """Play the evaluation episodes of the task on many phantoms with a trial's greedy actions."""
    loaded = load_agent(trial)
    config = loaded.config
    task = held_out.MANY[config.task]
    evaluator = Evaluator(task, config.noise, config.n_frames)
    played = evaluator.play(loaded.agent, checkpoint=config.steps, step=config.steps, deterministic=True)
    evaluator.close()
    anchors = asdict(suite.anchors(task, config.noise))
    table = pd.DataFrame([episode.as_row() for episode in played])
    return held_out.summary(trial.name, task, table, random=anchors["random"], optimal=anchors["optimal"])
