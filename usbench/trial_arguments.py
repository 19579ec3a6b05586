"""The arguments of the commands that train or test: run, compare, leaderboard, transfer and search."""

import argparse
from pathlib import Path
from typing import Any

from usbench import commands
from usbench.arguments import number, phantom, setting

RUN_EXAMPLES = """examples:
  usbench run --algo vpg --task pp
  usbench run --algo vpg --task fp --noise 0.25 --seed 3
  usbench run --algo vpg --task pp --preset spinup --set gamma=0.95 --out my_runs
  usbench run --algo dqn --task pp --phantom spine.mha frames=recorded target_x_mm=0 target_angle_deg=0
      in an anatomy of your own (docs/anatomy.md)
"""

COMPARE_EXAMPLES = """examples:
  usbench compare
      the paper's grid: vpg, a2c, ppo and dqn on both tasks with three noise levels and 4 seeds
  usbench compare --algos vpg ppo --tasks pp --noise 0 --seeds 10 --jobs 8
  usbench compare --steps 1024 --seeds 2 --out quick --leaderboard quick/leaderboard.md
      a minute's try
  usbench compare --cluster tcp://host:8786
      on the workers of a Dask cluster (docs/scaling.md)

What is finished is not run again, so the same command goes on after an interruption; with --report-only it
writes the leaderboard of what there is so far.
"""

SEARCH_EXAMPLES = """examples:
  usbench search --algo ppo
  usbench search --algo dqn --tasks pp --noise 0 --steps 8032 --candidates 10 --jobs 8
  usbench search --algo ppo --tasks pp --steps 8192 --candidates 8 --finalists 3
      many candidates on little, then the best three on both of the paper's tasks, two seeds, the whole budget

The same command goes on where it was stopped. Seeds begin at 1000, where no comparison has any.
"""


def add(subparsers: Any, debug: argparse.ArgumentParser) -> None:
    """Add the commands to the command line; `debug` is what all commands share."""
    _add_run(subparsers, debug)
    _add_compare(subparsers, debug)
    _add_leaderboard(subparsers, debug)
    _add_transfer(subparsers, debug)
    _add_search(subparsers, debug)


def _add_run(subparsers: Any, debug: argparse.ArgumentParser) -> None:
    run = subparsers.add_parser(
        "run",
        parents=[debug],
        epilog=RUN_EXAMPLES,
        help="train and evaluate one agent on one task",
        description="Train and evaluate one agent on one task; leave records, learning curve and replay.",
    )
    run.add_argument("--algo", required=True, help="algorithm, for example vpg (see usbench list)")
    run.add_argument("--task", required=True, help="task, for example pp (see usbench list)")
    run.add_argument("--noise", type=number, default=0.0, metavar="P", help="probability 0..1 (default 0)")
    run.add_argument("--seed", type=number, default=0, metavar="N", help="trial seed (default 0)")
    run.add_argument("--steps", type=number, metavar="N", help="training steps (default: the task's budget)")
    run.add_argument(
        "--n-frames", type=number, default=4, metavar="N", help="frames in one observation (default 4)"
    )
    run.add_argument(
        "--reward",
        default="normalized",
        metavar="KIND",
        help="what is trained on: normalized (default), or image, computed from the frame alone; "
        "scores are those of the true reward",
    )
    phantom(run, "target_x_mm and target_angle_deg or target_focal_depth_mm say where it is seen best")
    run.add_argument("--preset", metavar="NAME", help="named hyperparameters, for example spinup")
    run.add_argument(
        "--set",
        action="extend",
        nargs="+",
        type=setting,
        default=[],
        metavar="NAME=VALUE",
        help="hyperparameters, for example n_value_steps=80",
    )
    run.add_argument("--out", type=Path, default=Path("runs"), help="folder for trials (default runs)")
    run.add_argument("--overwrite", action="store_true", help="run again even if finished")
    run.add_argument(
        "--wandb", action="store_true", help="let Weights & Biases follow the training; needs usbench[wandb]"
    )
    run.add_argument("--quiet", action="store_true", help="no progress")
    run.set_defaults(call=commands.run)


def _add_compare(subparsers: Any, debug: argparse.ArgumentParser) -> None:
    compare = subparsers.add_parser(
        "compare",
        parents=[debug],
        epilog=COMPARE_EXAMPLES,
        help="compare algorithms and write a leaderboard",
        description="Run the trials that are missing, several at a time; write the leaderboard, "
        "scores.csv beside it, and tables and figures in a folder beside it. random, stay and oracle always "
        "take part.",
    )
    compare.add_argument(
        "--algos",
        nargs="+",
        default=["vpg", "a2c", "ppo", "dqn"],
        metavar="NAME",
        help="algorithms, also your own as module:name (default vpg a2c ppo dqn; see usbench list)",
    )
    compare.add_argument(
        "--tasks", nargs="+", default=["fp", "pp"], metavar="NAME", help="tasks (default fp pp)"
    )
    compare.add_argument(
        "--noise",
        nargs="+",
        type=number,
        default=[0.0, 0.25, 0.5],
        metavar="P",
        help="probabilities 0..1 (default 0 0.25 0.5)",
    )
    compare.add_argument("--seeds", type=number, default=4, metavar="N", help="number of seeds (default 4)")
    compare.add_argument(
        "--steps", type=number, metavar="N", help="training steps (default: the task's budget)"
    )
    _add_leaderboard_file(compare)
    _add_sweep(compare)
    compare.add_argument(
        "--cluster",
        metavar="ADDRESS",
        help="run the trials on a Dask cluster, for example tcp://host:8786; needs usbench[dask]",
    )
    compare.add_argument(
        "--report-only", action="store_true", help="run nothing: write the leaderboard of what is finished"
    )
    compare.set_defaults(call=commands.compare)


def _add_leaderboard(subparsers: Any, debug: argparse.ArgumentParser) -> None:
    leaderboard = subparsers.add_parser(
        "leaderboard",
        parents=[debug],
        help="write a leaderboard again, from its tables, from every trial in a folder, or from both",
        description="Write the leaderboard, scores.csv beside it and the figures again, from the tables that "
        "compare left in the folder beside it (leaderboard_files), of several comparisons together, or with "
        "more trials; no trial is run.",
    )
    source = leaderboard.add_mutually_exclusive_group()
    source.add_argument(
        "--runs", type=Path, metavar="DIR", help="folder with trials: read all of them, whatever compare read"
    )
    source.add_argument(
        "--add", type=Path, metavar="DIR", help="folder with trials: add them to those of the tables"
    )
    _add_leaderboard_file(leaderboard)
    leaderboard.set_defaults(call=commands.leaderboard)


def _add_transfer(subparsers: Any, debug: argparse.ArgumentParser) -> None:
    transfer = subparsers.add_parser(
        "transfer",
        parents=[debug],
        help="test agents of one phantom on phantoms never seen",
        description="Test every agent of a comparison that was trained on one phantom (fp, pp) on the "
        "evaluation phantoms of the same task with many (fp-random, pp-random), and write the leaderboard "
        "with both side by side: usbench compare --tasks pp pp-random, then this. What was tested is not "
        "tested again.",
    )
    transfer.add_argument(
        "--algos",
        nargs="+",
        metavar="NAME",
        help="only these (default: all but your own, module:name, whose code is run if they are named)",
    )
    transfer.add_argument(
        "--out", type=Path, default=Path("runs"), help="folder with the comparison's trials (default runs)"
    )
    _add_leaderboard_file(transfer)
    transfer.add_argument("--quiet", action="store_true", help="no progress")
    transfer.set_defaults(call=commands.transfer)


def _add_leaderboard_file(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--leaderboard",
        type=Path,
        default=Path("leaderboard.md"),
        metavar="FILE",
        help="file to write (default leaderboard.md)",
    )


def _add_search(subparsers: Any, debug: argparse.ArgumentParser) -> None:
    search = subparsers.add_parser(
        "search",
        parents=[debug],
        epilog=SEARCH_EXAMPLES,
        help="search hyperparameters of an algorithm",
        description="Try hyperparameters of one algorithm and write a table; needs usbench[search].",
    )
    search.add_argument("--algo", required=True, help="algorithm, for example ppo (see usbench list)")
    search.add_argument(
        "--tasks", nargs="+", default=["fp", "pp"], metavar="NAME", help="tasks (default fp pp)"
    )
    search.add_argument("--noise", type=number, default=0.25, metavar="P", help="0..1 (default 0.25)")
    search.add_argument(
        "--seeds", type=number, default=1, metavar="N", help="seeds per candidate (default 1)"
    )
    search.add_argument(
        "--steps", type=number, metavar="N", help="training steps (default: the task's budget)"
    )
    search.add_argument(
        "--candidates", type=number, default=20, metavar="N", help="candidates in all (default 20)"
    )
    search.add_argument(
        "--finalists",
        type=number,
        metavar="N",
        help="train so many of the best again, on the paper's tasks with other seeds (default none)",
    )
    _add_sweep(search)
    search.set_defaults(call=commands.search)


def _add_sweep(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--jobs", type=number, metavar="N", help="trials at a time (default: all cores)")
    parser.add_argument("--out", type=Path, default=Path("runs"), help="folder for trials (default runs)")
    parser.add_argument("--quiet", action="store_true", help="no progress")
