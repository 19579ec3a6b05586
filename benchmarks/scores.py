"""Train one agent on both tasks with several seeds and print the scores: `make scores`."""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from itertools import product
from pathlib import Path

import pandas as pd
from rich.console import Console
from rich.table import Table

from usbench import records
from usbench.records.configuration import digest

CELL = ["algo", "task", "settings", "deterministic"]


def train(task: str, seed: int, args: argparse.Namespace) -> None:
    """Run one trial in a separate process; a finished trial is not run again."""
    settings = ["--set", *args.set] if args.set else []
    command = ["run", "--algo", args.algo, "--task", task, "--seed", str(seed), "--out", args.out, "--quiet"]
    subprocess.run(
        [sys.executable, "-m", "usbench", *command, *settings],
        check=True,
        stdout=subprocess.DEVNULL,
        env={**os.environ, "USBENCH_THREADS": "1"},
    )


def trials(out: Path) -> pd.DataFrame:
    """Return a row per finished trial: `trial`, `minutes` of training, `settings` that not all trials share.

    Only trials of the same algorithm on the same task are compared.
    """
    finished = [trial for trial in records.load_trials(out) if trial.status == "finished"]
    if not finished:
        raise SystemExit(f"there is no finished trial in {str(out)!r}.")
    kinds: dict[tuple[str, str], list[dict[str, object]]] = {}
    for trial in finished:
        kinds.setdefault(_kind(trial), []).append(_settings(trial))
    rows = []
    for trial in finished:
        others = kinds[_kind(trial)]
        own = [
            f"{key}={value}" if isinstance(value, str) else f"{key}={value:g}"
            for key, value in _settings(trial).items()
            if any(key not in other or other[key] != value for other in others)
        ]
        minutes = trial.timings.get("training_s", 0.0) / 60
        rows.append({"trial": trial.name, "minutes": minutes, "settings": "\n".join(own)})
    return pd.DataFrame(rows)


def _kind(trial: records.Trial) -> tuple[str, str]:
    return trial.config.algo, trial.config.task


def _settings(trial: records.Trial) -> dict[str, object]:
    """Return what makes an agent another one, its environment as a digest."""
    config = trial.config
    cell = {key: getattr(config, key) for key in ("noise", "steps", "n_frames", "n_envs")}
    environment = digest(records.identity({"environment": config.environment})["environment"])
    return {**config.hyperparameters, **cell, "environment": environment}


def table(out: Path) -> Table:
    """Return the scores after the last step: a row per agent, task, settings and kind of actions."""
    finished = trials(out)
    rows = records.load(out).merge(finished, on="trial")
    rows = rows[rows["checkpoint"] == rows.groupby("trial")["checkpoint"].transform("max")]
    scores = rows.groupby([*CELL, "seed", "trial"]).agg(
        score=("normalized_score", "mean"), minutes=("minutes", "first")
    )
    n_left_out = len(records.trial_folders(out)) - len(finished)
    caption = f"Left out: {n_left_out} unfinished." if n_left_out else None
    columns = ("agent", "task", "settings", "actions", "seeds", "normalised score of each")
    result = Table(*columns, caption=caption)
    for name in ("mean", "standard\ndeviation", "minutes of\ntraining"):
        result.add_column(name, justify="right", no_wrap=True)
    for (algo, task, settings, greedy), cell in scores.groupby(level=CELL):
        values = cell["score"]
        seeds = " ".join(map(str, cell.index.get_level_values("seed")))
        each = " ".join(f"{value:.2f}" for value in values)
        spread = f"{values.std():.3f}" if len(values) > 1 else ""
        actions = "greedy" if greedy else "sampled"
        numbers = f"{values.mean():.3f}", spread, f"{cell['minutes'].mean():.1f}"
        result.add_row(algo, task, settings, actions, seeds, each, *numbers)
    return result


def main() -> None:
    """Train what is missing, then print the scores of everything in the folder."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--algo", default="vpg")
    parser.add_argument("--tasks", nargs="+", default=["pp", "fp"])
    parser.add_argument(
        "--seeds", type=int, default=4, help="number of seeds (default 4); 0 prints what is there"
    )
    parser.add_argument("--first-seed", type=int, default=0, help="the first seed (default 0)")
    parser.add_argument("--jobs", type=int, default=2, help="trials at a time (default 2)")
    parser.add_argument("--set", nargs="+", default=[], metavar="NAME=VALUE")
    parser.add_argument("--out", default="runs")
    args = parser.parse_args()
    if min(args.seeds, args.first_seed) < 0:
        parser.error("--seeds and --first-seed must be whole numbers of at least 0.")
    seeds = range(args.first_seed, args.first_seed + args.seeds)
    with ThreadPoolExecutor(args.jobs) as pool:
        list(pool.map(lambda trial: train(*trial, args), product(args.tasks, seeds)))
    Console(width=110).print(table(Path(args.out)))


if __name__ == "__main__":
    main()
