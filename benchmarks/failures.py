"""Where agents fail: poses that look alike, and how episodes end: `make failures`.

Prints both tables for docs/failures.md and draws its figure. Look-alikes come from the frames of the default
phantom, the ends of episodes from the records of a folder of trials.
"""

import argparse
from pathlib import Path

import numpy as np
import pandas as pd
from rich.console import Console
from rich.table import Table

from usbench import drawing, failures, look_alikes, records, suite
from usbench.envs.frames import frame_store


def frames(task: str) -> np.ndarray:
    """Return the frames of all states of `task`, (n_states, height, width)."""
    env = suite.make_env(task).unwrapped
    store = frame_store(env.phantom, env.probe, env.imaging)
    store.prepare(env.task.states)
    return np.stack([store.frame(pose) for pose in env.task.states])


def printed(rows: pd.DataFrame, title: str) -> Table:
    """Return `rows` as a table: numbers with two digits, nothing where there is none."""
    table = Table(*(str(name).replace("_", " ") for name in rows.columns), title=title)
    for row in rows.itertuples(index=False):
        table.add_row(*("" if pd.isna(v) else f"{v:.2f}" if isinstance(v, float) else str(v) for v in row))
    return table


def main() -> None:
    """Print the tables; draw the figure where asked to."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=Path, default=Path("runs"), help="folder of trials (default runs)")
    parser.add_argument("--pairs", type=int, default=8, help="look-alikes per task (default 8)")
    parser.add_argument("--figure", type=Path, help="also draw the look-alikes here (PNG, SVG or PDF)")
    args = parser.parse_args()
    known = {suite.TASKS[task].guidance: frames(task) for task in suite.PAPER}
    console = Console(width=110)
    for task, own in known.items():
        pairs = look_alikes.most_alike(task, own, args.pairs).round({"correlation": 3})
        pairs["correlation"] = pairs["correlation"].map("{:.3f}".format)
        console.print(printed(pairs, f"{task.title}: look-alikes that need different actions"))
    if args.figure:
        drawing.save(look_alikes.draw(known), args.figure)
    if args.runs.is_dir() and not (evaluations := records.load(args.runs)).empty:
        finished = evaluations[evaluations["status"] == "finished"]
        console.print(printed(failures.shares(finished), "How episodes end, greedy actions, as shares"))


if __name__ == "__main__":
    main()
