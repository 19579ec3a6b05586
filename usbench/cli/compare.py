"""`usbench compare`: compare algorithms and write a leaderboard."""

from __future__ import annotations

import argparse
import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from usbench.cli.arguments import (
    GOES_ON,
    LEADERBOARD,
    add_leaderboard_file,
    add_senses,
    add_sweep,
    number,
    tell_watcher,
)

if TYPE_CHECKING:
    from usbench.compare.sweep import Outcome
    from usbench.records import TrialConfig


# Where the leaderboards of the protocol's further tables are, each with its files in a folder of its own.
TABLES = Path("tables")

EXAMPLES = """examples:
  usbench compare
      the grid of the protocol: every algorithm on both tasks with three noise
      levels and 10 seeds
  usbench compare --table single-frames
      a further table of the protocol, with a leaderboard apart:
      tables/single-frames/leaderboard.md
  usbench compare --algos vpg ppo --tasks pp --noise 0 --seeds 10 --jobs 8
  usbench compare --algos double_dqn --tasks pp-tracked --noise 0 --seeds 4 \\
      --n-frames 2 --senses position heading actions --out tracked
      an agent that is told its own last action, on unseen phantoms
  usbench compare --algos vpg dqn --tasks pp --noise 0 --steps 1024 --seeds 2 \\
      --out quick --leaderboard quick/leaderboard.md
      a try of some minutes
  usbench compare --cluster tcp://host:8786
      on the workers of a Dask cluster (docs/scaling.md)

What is finished is not run again, so the same command goes on after an
interruption; with --report-only it writes the leaderboard of what there is.
"""


def add(subparsers: Any, debug: argparse.ArgumentParser) -> None:
    """Add the command to the command line; `debug` is what all commands share."""
    compare = subparsers.add_parser(
        "compare",
        parents=[debug],
        epilog=EXAMPLES,
        help="compare algorithms and write a leaderboard",
        description="Run the trials that are missing, several at a time; write the leaderboard, "
        "a table of scores beside it, and tables and figures in a folder beside it. random, stay and oracle "
        "always take part.",
    )
    compare.add_argument(
        "--algos",
        nargs="+",
        metavar="NAME",
        help="algorithms, also your own as module:name (default: those of the protocol; see usbench list)",
    )
    compare.add_argument(
        "--table",
        metavar="NAME",
        help="a further table of the protocol in place of its grid, for example single-frames",
    )
    compare.add_argument("--tasks", nargs="+", metavar="NAME", help="tasks (default: those of the protocol)")
    compare.add_argument(
        "--noise",
        nargs="+",
        type=number,
        metavar="P",
        help="probabilities that the probe slips after an action, 0 to 1 (default: those of the protocol)",
    )
    compare.add_argument(
        "--seeds",
        type=number,
        metavar="N",
        help="number of seeds, the first of those that are kept for comparisons (default: as the protocol)",
    )
    compare.add_argument(
        "--steps", type=number, metavar="N", help="training steps (default: the task's budget)"
    )
    compare.add_argument(
        "--n-frames",
        type=number,
        metavar="N",
        help="frames in one observation of agents that learn on unseen phantoms (default 4)",
    )
    add_senses(compare, " on unseen phantoms, if it learns")
    add_leaderboard_file(
        compare,
        "leaderboard.md, and tables/NAME/leaderboard.md with --table NAME; below the folder of the trials "
        "where that would lose others, as in a clone",
    )
    compare.set_defaults(leaderboard=None)
    add_sweep(compare)
    compare.add_argument(
        "--cluster",
        metavar="ADDRESS",
        help="run the trials on a Dask cluster, for example tcp://host:8786; needs usbench[dask]",
    )
    compare.add_argument(
        "--report-only", action="store_true", help="run nothing: write the leaderboard of what is finished"
    )
    compare.set_defaults(call=_call, interrupted=GOES_ON)


def _call(args: argparse.Namespace) -> None:
    """Run what is missing of a comparison, then write its leaderboard and figures."""
    tell_watcher("looking at the trials that there are: some seconds", args.quiet)
    tell = partial(print, file=sys.stderr)
    from usbench import records
    from usbench.cli.output import sweep_output
    from usbench.compare import plan, protocol, rest, runs
    from usbench.results import leaderboard

    jobs = None if args.jobs is None else plan.positive("jobs", args.jobs)
    rules = protocol.read()
    planned = plan.by_protocol(
        rules,
        args.table,
        algos=args.algos or rest.rows(rules, args.table, args.out, leaderboard.files(LEADERBOARD)),
        tasks=args.tasks,
        noises=args.noise,
        n_seeds=args.seeds,
        steps=args.steps,
        n_frames=args.n_frames,
        senses=args.senses,
    )
    if args.report_only:
        records.existing(args.out)
    usual = LEADERBOARD if args.table is None else TABLES / args.table / LEADERBOARD
    names = [config.folder_name for config in planned]
    path = runs.place(usual, args.out, names, tell, named=args.leaderboard)
    with leaderboard.prepared(path):
        outcomes = [] if args.report_only else _run_missing(args, planned, jobs)
        # First: damaged records make no leaderboard.
        failed = sweep_output.failures(outcomes)
        for line in failed:
            print(line, file=sys.stderr)
        for written in runs.report(planned, args.out, path):
            print(written)
    if failed:
        raise RuntimeError(
            f"{len(failed)} of {len(planned)} trials failed; the same command tries them again."
        )


def _run_missing(args: argparse.Namespace, planned: list[TrialConfig], jobs: int | None) -> list[Outcome]:
    from usbench.cli.output import sweep_output
    from usbench.compare import sweep
    from usbench.envs.threads import n_threads

    with sweep_output.SweepBars(args.quiet) as bars:
        if args.cluster is None:
            return sweep.run(planned, args.out, bars, jobs=jobs or n_threads())
        from usbench.compare.dask_cluster import Cluster

        with Cluster(args.cluster) as workers:
            return sweep.run(
                planned,
                args.out,
                bars,
                jobs=jobs or workers.n_workers,
                executor=lambda: workers,
                # All at once, for workers that are still to come.
                submitted=jobs or len(planned),
            )
