"""`usbench dataset`: play episodes and write them as a data set of Minari."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from usbench.cli.arguments import number, tell_watcher, teller

EXAMPLES = """examples:
  usbench dataset --task pp --agent best --episodes 1000
      minari.load_dataset("usbench/pp/best-v0") opens it
  usbench dataset --task fp --agent mixed --episodes 300 --noise 0.25 --out data
  usbench dataset --task pp --agent runs/pp-p0-dqn-s0-0fee56f0 --episodes 100
"""


def add(subparsers: Any, debug: argparse.ArgumentParser) -> None:
    """Add the command to the command line; `debug` is what all commands share."""
    dataset = subparsers.add_parser(
        "dataset",
        parents=[debug],
        epilog=EXAMPLES,
        help="write episodes of an agent as a data set for offline learning",
        description="Play episodes, write them as a data set of Minari with a card; needs usbench[minari].",
    )
    dataset.add_argument("--task", required=True, metavar="NAME", help="task (see usbench list)")
    dataset.add_argument(
        "--agent",
        required=True,
        metavar="NAME",
        help="oracle, best (the trained agent that comes with the package), random, mixed (the three in "
        "turn), the folder of a trial, or an agent of the package by its name, such as vpg:pp",
    )
    dataset.add_argument("--episodes", type=number, default=1000, metavar="N", help="(default 1000)")
    dataset.add_argument(
        "--noise",
        type=number,
        default=0.0,
        metavar="P",
        help="probability that the probe slips after an action, 0 to 1 (default 0)",
    )
    dataset.add_argument(
        "--seed", type=number, default=0, metavar="N", help="seed of the episodes (default 0)"
    )
    dataset.add_argument("--out", type=Path, metavar="FOLDER", help="folder (default: where Minari looks)")
    dataset.add_argument("--quiet", action="store_true", help="no progress")
    kept = "no data set was written: frames on disk are kept, and the same command plays all episodes again."
    dataset.set_defaults(call=_call, interrupted=kept)


def _call(args: argparse.Namespace) -> None:
    """Play the episodes, write the data set, and tell how it is opened."""
    tell_watcher("loading PyTorch: some seconds", args.quiet)
    from usbench.datasets import minari_files

    tell = teller(args.quiet)
    name, folder = minari_files.write(
        args.task, args.agent, args.episodes, noise=args.noise, seed=args.seed, out=args.out, tell=tell
    )
    place = "" if args.out is None else f"  (with {minari_files.PLACE}={args.out.resolve()})"
    print(f"{folder}: {minari_files.size_bytes(folder) / 1e6:.1f} MB")
    print(f'minari.load_dataset("{name}"){place}')
