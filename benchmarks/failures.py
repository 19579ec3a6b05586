"""Where agents fail: poses that look alike, how episodes end, what frames and steps change: `make failures`.

Prints the tables for docs/failures.md and draws its figures. Look-alikes come from the frames of the default
phantom, all else from the records in folders of trials. How episodes end is kept in a table beside its
figure: trials add their rows to it, cell by cell, and the figure is drawn from the whole table.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from rich.console import Console
from rich.table import Column, Table

from usbench import records, suite
from usbench.checks import ConfigurationError
from usbench.compare import plan, protocol
from usbench.envs.frames import frame_store
from usbench.figures import episode_ends, look_alikes, style
from usbench.records import TrialConfig
from usbench.results import collecting, sources
from usbench.results.protocol.changes import changes
from usbench.setting import make_env

NOT_DRAWN = ("random", "stay")


def frames(task: str) -> np.ndarray:
    """Return the frames of all states of `task`, (n_states, height, width)."""
    env = make_env(task).unwrapped
    store = frame_store(env.phantom, env.probe, env.imaging)
    store.prepare(env.task.states)
    return np.stack([store.frame(pose) for pose in env.task.states])


def ends_of(runs: Path, planned: Sequence[TrialConfig]) -> pd.DataFrame | None:
    """Return how episodes of the paper's tasks end, of the finished trials in `runs` that are `planned`.

    None where there are none. Where nothing is planned, all trials count.
    """
    if not runs.is_dir() or (evaluations := records.load(runs)).empty:
        return None
    trials = collecting.collect(runs, planned).trials
    own = trials[(trials["status"] == "finished") & trials["task"].isin(suite.PAPER)]
    chosen = evaluations[evaluations["trial"].isin(own["trial"])]
    return None if chosen.empty else episode_ends.shares(chosen)


def changes_of(runs: Path, others: Path, varied: str) -> pd.DataFrame:
    """Return what `varied` changes in the scores, of `others` and of the folder `runs` if there is one.

    Raises:
        ConfigurationError: If there is no folder `others`, or records are broken.
    """
    folders = [*([runs] if runs.is_dir() else []), others]
    return changes(sources.gather(folders), varied)


def printed(rows: pd.DataFrame, title: str) -> Table:
    """Return `rows` as a table: numbers with two digits, an empty cell where there is no number."""
    columns = [Column(str(name).replace("_", " "), overflow="fold") for name in rows.columns]
    table = Table(*columns, title=title)
    for row in rows.itertuples(index=False):
        table.add_row(*("" if pd.isna(v) else f"{v:.2f}" if isinstance(v, float) else str(v) for v in row))
    return table


def main() -> None:
    """Print the tables; draw the figures that the arguments ask for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=Path, default=Path("runs"), help="folder of trials (default runs)")
    parser.add_argument(
        "--all",
        action="store_true",
        help="how episodes end: of all trials in --runs, not of the grid's alone",
    )
    parser.add_argument("--frames", type=Path, help="trials, or tables, with several numbers of frames")
    parser.add_argument("--budgets", type=Path, help="trials, or tables, with several budgets")
    parser.add_argument("--pairs", type=int, default=8, help="look-alikes per task (default 8)")
    parser.add_argument("--figure", type=Path, help="also draw the look-alikes here (PNG, SVG or PDF)")
    parser.add_argument("--ends", type=Path, help="also draw here how episodes end; the table .csv beside it")
    args = parser.parse_args()
    try:
        changed = [
            (changes_of(args.runs, others, varied), title)
            for others, varied, title in (
                (args.frames, "n_frames", "Scores by the frames of an observation"),
                (args.budgets, "steps", "Scores by the steps of the training"),
            )
            if others
        ]
    except ConfigurationError as error:
        parser.error(str(error))
    known = {suite.TASKS[task].guidance: frames(task) for task in suite.PAPER}
    console = Console(width=110)
    for task, own in known.items():
        pairs = look_alikes.most_alike(task, own, args.pairs).round({"correlation": 3})
        pairs["correlation"] = pairs["correlation"].map("{:.3f}".format)
        console.print(printed(pairs, f"{task.title}: look-alikes that need different actions"))
    if args.figure:
        style.save(look_alikes.draw(known), args.figure)
    planned = [] if args.all else plan.by_protocol(protocol.read())
    ends, table = ends_of(args.runs, planned), args.ends and args.ends.with_suffix(".csv")
    if table and table.exists():
        kept = pd.read_csv(table)
        ends = kept if ends is None else episode_ends.merged(kept, ends)
    if ends is not None and table:
        ends.to_csv(table, index=False, float_format="%.4f", lineterminator="\n")
    if ends is not None:
        console.print(printed(ends, "How episodes end, greedy actions, as shares"))
        if args.ends:
            style.save(episode_ends.draw(ends[~ends["algo"].isin(NOT_DRAWN)]), args.ends)
    for rows, title in changed:
        console.print(printed(rows, title))


if __name__ == "__main__":
    main()
