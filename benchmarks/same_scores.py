"""Scores of agents that plain scripts train, beside those of agents trained here.

`python benchmarks/same_scores.py` trains every algorithm with four seeds of development for the whole budget,
here and in the plain scripts that `make bench-train` times, and plays the same evaluation episodes with
greedy actions: some four hours of one core. Each agent adds a row to docs/plain_scores.csv, and what is there
is not trained again. Agents of Stable-Baselines3 begin with the same weights and draws in both, and part by
rounding; those of vpg begin with their own.
"""

import argparse
import csv
import time
from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from rich.console import Console
from rich.table import Table
from scipy import stats
from training import ALGOS, make

ROWS = Path(__file__).parents[1] / "docs" / "plain_scores.csv"
COLUMNS = ("algo", "task", "program", "seed", "steps", "score", "cpu_s")
PROGRAMS = ("here", "plain")
SEEDS = range(4)
CAPTION = (
    "Normalised scores on {task} with greedy actions after {steps} steps (and what fills the last rollout), "
    "mean (least to most) of the seeds; the difference of the means (plain less here) has Welch's 95 % "
    "interval."
)


class ChannelsFirst:
    """A plain script's agent, asked with observations as environments here give them, channels last."""

    def __init__(self, model: Any) -> None:
        """Take the model."""
        self._model = model

    def predict(self, observation: npt.NDArray[np.float32], **asked: Any) -> tuple[npt.NDArray[Any], Any]:
        """Return actions `(n,)` for observations `(n, height, width, frames)`, and the next state."""
        actions, state = self._model.predict(np.ascontiguousarray(observation.transpose(0, 3, 1, 2)), **asked)
        return actions, state


def score(agent: Any, task: str, steps: int) -> float:
    """Return the normalised score of an agent in the evaluation episodes, with greedy actions."""
    from usbench.setting import Setting
    from usbench.trials.evaluation import Evaluator

    setting = Setting(task=task)
    evaluator = Evaluator(setting, setting.evaluation_episodes())
    played = evaluator.play(agent, checkpoint=steps, step=steps, deterministic=True)
    evaluator.close()
    return float(setting.anchors().score(np.mean([episode.as_row()["return"] for episode in played])))


def trained(program: str, algo: str, task: str, seed: int, steps: int) -> dict[str, object]:
    """Train an agent and return its row."""
    import torch

    torch.set_num_threads(1)
    model, since = make(program, algo, task, seed), time.process_time()
    model.learn(steps)
    seconds = time.process_time() - since
    agent = model if program == "here" else ChannelsFirst(model)
    found = (algo, task, program, seed, steps, round(score(agent, task, steps), 5), round(seconds, 1))
    return dict(zip(COLUMNS, found, strict=True))


def known() -> list[dict[str, str]]:
    """Return the rows that there are."""
    if not ROWS.is_file():
        return []
    with ROWS.open(newline="") as file:
        return list(csv.DictReader(file))


def add(row: Mapping[str, object]) -> None:
    """Add a row to the file, which is made if need be."""
    new = not ROWS.is_file()
    with ROWS.open("a", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        if new:
            writer.writeheader()
        writer.writerow(row)


def table(task: str, steps: int) -> Table:
    """Return the scores of every algorithm that both programs have trained."""
    caption = CAPTION.format(task=task, steps=steps)
    shown = Table("algorithm", *PROGRAMS, "difference [95 %]", caption=caption, caption_justify="left")
    rows = [row for row in known() if (row["task"], row["steps"]) == (task, str(steps))]
    for algo in ALGOS:
        here, plain = (
            [float(row["score"]) for row in rows if (row["algo"], row["program"]) == (algo, program)]
            for program in PROGRAMS
        )
        if min(len(here), len(plain)) > 1:
            shown.add_row(algo, words(here), words(plain), difference(here, plain))
    return shown


def words(scores: Sequence[float]) -> str:
    """Return the mean, and the least and the largest."""
    return f"{np.mean(scores):.3f} ({min(scores):.3f} to {max(scores):.3f})"


def difference(here: Sequence[float], plain: Sequence[float]) -> str:
    """Return by how much the mean of the plain scripts is larger, with its interval."""
    ends = stats.ttest_ind(plain, here, equal_var=False).confidence_interval(0.95)
    return f"{np.mean(plain) - np.mean(here):+.3f} [{ends.low:+.3f}, {ends.high:+.3f}]"


def main() -> None:
    """Train what is missing and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--algos", nargs="+", default=ALGOS, choices=ALGOS, metavar="NAME")
    parser.add_argument("--task", default="fp", choices=("fp", "pp"))
    parser.add_argument("--steps", type=int, default=16064, help="(default 16064)")
    parser.add_argument("--table", action="store_true", help="print what is known, train nothing")
    args = parser.parse_args()
    done = {tuple(row[name] for name in COLUMNS[:5]) for row in known()}
    asked = [] if args.table else list(product(SEEDS, args.algos, PROGRAMS))
    for number, (seed, algo, program) in enumerate(asked, 1):
        if (algo, args.task, program, str(seed), str(args.steps)) not in done:
            print(f"{number} of {len(asked)}: {algo}, {program}, seed {seed}", flush=True)
            add(trained(program, algo, args.task, seed, args.steps))
    Console(width=110).print(table(args.task, args.steps))


if __name__ == "__main__":
    main()
