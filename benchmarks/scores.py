"""Train one agent on both tasks with several seeds and print the scores: `make scores`."""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from itertools import product

from rich.console import Console
from rich.table import Table

from usbench import records


def train(task: str, seed: int, args: argparse.Namespace) -> None:
    """Run one trial as a command of its own; a finished one is not run again."""
    settings = ["--set", *args.set] if args.set else []
    command = ["run", "--algo", args.algo, "--task", task, "--seed", str(seed), "--out", args.out, "--quiet"]
    subprocess.run(
        [sys.executable, "-m", "usbench", *command, *settings],
        check=True,
        stdout=subprocess.DEVNULL,
        env={**os.environ, "USBENCH_THREADS": "1"},
    )


def main() -> None:
    """Train what is missing, then print the scores of everything in the folder."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--algo", default="vpg")
    parser.add_argument("--tasks", nargs="+", default=["pp", "fp"])
    parser.add_argument("--seeds", type=int, default=4, help="number of seeds (default 4)")
    parser.add_argument("--jobs", type=int, default=2, help="trials at a time (default 2)")
    parser.add_argument("--set", nargs="+", default=[], metavar="NAME=VALUE")
    parser.add_argument("--out", default="runs")
    args = parser.parse_args()
    with ThreadPoolExecutor(args.jobs) as pool:
        list(pool.map(lambda trial: train(*trial, args), product(args.tasks, range(args.seeds))))

    rows = records.load(args.out)
    rows = rows[rows["checkpoint"] == rows.groupby("trial")["checkpoint"].transform("max")]
    means = rows.groupby(["algo", "task", "deterministic", "trial"])["normalized_score"].mean()
    table = Table("agent", "task", "actions", "seeds", "normalised score of each", "mean")
    for (algo, task, greedy), values in means.groupby(level=[0, 1, 2]):
        each = " ".join(f"{value:.2f}" for value in values)
        actions = "greedy" if greedy else "drawn"
        table.add_row(algo, task, actions, str(len(values)), each, f"{values.mean():.3f}")
    Console(width=110).print(table)


if __name__ == "__main__":
    main()
