"""Scores of agents that plain scripts train, beside those of the leaderboard's agents.

`python benchmarks/same_scores.py` trains every algorithm with four seeds of development for the whole budget
in the plain scripts that `make bench-train` times, plays the evaluation episodes with greedy actions, and
compares the scores with those of the leaderboard's ten seeds, which the same settings had here: some three
hours of one core. Each agent adds a row to docs/plain_scores.csv, and what is there is not trained again.
"""

import argparse
import csv
import time
from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from rich.console import Console
from rich.table import Table
from scipy import stats
from training import ALGOS, make

from usbench.results import scores, tables
from usbench.results.agents import named
from usbench.tasks import row_of

ROOT = Path(__file__).parents[1]
GRID = ROOT / "leaderboard_files"
ROWS = ROOT / "docs" / "plain_scores.csv"
COLUMNS = ("algo", "task", "seed", "steps", "score", "cpu_s")
SEEDS = range(4)
CAPTION = (
    "Normalised scores on {task} without noise with greedy actions after {steps} steps (and what fills the "
    "last rollout), mean (least to most, number of seeds); the difference of the means (plain less "
    "leaderboard) has Welch's 95 % interval."
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


def trained(algo: str, task: str, seed: int, steps: int) -> dict[str, object]:
    """Train an agent with a plain script and return its row."""
    import torch

    torch.set_num_threads(1)
    model, since = make("plain", algo, task, seed), time.process_time()
    model.learn(steps)
    seconds = time.process_time() - since
    found = (algo, task, seed, steps, round(score(ChannelsFirst(model), task, steps), 5), round(seconds, 1))
    return dict(zip(COLUMNS, found, strict=True))


def known() -> list[dict[str, str]]:
    """Return the rows that there are."""
    if not ROWS.is_file():
        return []
    with ROWS.open(newline="") as file:
        return list(csv.DictReader(file))


def of_leaderboard(task: str, steps: int) -> dict[str, list[float]]:
    """Return the final scores of the leaderboard's agents without noise, by the names of their rows."""
    results = tables.read(GRID)
    own = named(results.trials)
    own = own[(own["task"] == task) & (own["noise"] == 0) & (own["steps"] == steps)]
    final = scores.last(results.of(own)).merge(own[["trial", "agent"]], on="trial")
    return final.groupby("agent")["normalized_score"].apply(list).to_dict()


def add(row: Mapping[str, object]) -> None:
    """Add a row to the file, which is made if need be."""
    new = not ROWS.is_file()
    with ROWS.open("a", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        if new:
            writer.writeheader()
        writer.writerow(row)


def compared(task: str, steps: int) -> Iterator[tuple[str, str, str, str]]:
    """Yield the names of algorithms that have several scores of both, with both and their difference."""
    rows = [row for row in known() if (row["task"], row["steps"]) == (task, str(steps))]
    of_agents = of_leaderboard(task, steps)
    for algo in ALGOS:
        plain = [float(row["score"]) for row in rows if row["algo"] == algo]
        here = of_agents.get(algo, [])
        if min(len(here), len(plain)) > 1:
            yield algo, words(here), words(plain), difference(here, plain)


def words(scores: Sequence[float]) -> str:
    """Return the mean, the least and the largest, and how many there are."""
    return f"{np.mean(scores):.3f} ({min(scores):.3f} to {max(scores):.3f}, {len(scores)})"


def difference(here: Sequence[float], plain: Sequence[float]) -> str:
    """Return by how much the mean of the plain scripts is larger, with its interval."""
    ends = stats.ttest_ind(plain, here, equal_var=False).confidence_interval(0.95)
    return f"{np.mean(plain) - np.mean(here):+.3f} [{ends.low:+.3f}, {ends.high:+.3f}]"


def main() -> None:
    """Train what is missing and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--algos", nargs="+", default=ALGOS, choices=ALGOS, metavar="NAME")
    parser.add_argument("--task", default="fp", choices=("fp", "pp"))
    parser.add_argument("--table", action="store_true", help="print what is known, train nothing")
    args = parser.parse_args()
    steps = row_of(args.task).steps
    done = {tuple(row[name] for name in COLUMNS[:4]) for row in known()}
    asked = [] if args.table else list(product(args.algos, SEEDS))
    for number, (algo, seed) in enumerate(asked, 1):
        if (algo, args.task, str(seed), str(steps)) not in done:
            print(f"{number} of {len(asked)}: {algo}, seed {seed}", flush=True)
            add(trained(algo, args.task, seed, steps))
    caption = CAPTION.format(task=args.task, steps=steps)
    heads = ("algorithm", "leaderboard", "plain", "difference [95 %]")
    table = Table(*heads, caption=caption, caption_justify="left")
    for row in compared(args.task, steps):
        table.add_row(*row)
    Console(width=110).print(table)


if __name__ == "__main__":
    main()
