"""`usbench plot`: draw figures of any set of trials."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from usbench.cli.arguments import add_runs, runs_or, tell_watcher

EXAMPLES = """examples:
  usbench plot
      the leaderboard's figures of all trials in runs
  usbench plot runs/pp-p0-vpg-s0-f5fd15c6 --format png svg pdf
      of one trial, with its learning curve
  usbench plot leaderboard_files --out paper --format pdf
      from the tables that compare left
  usbench plot published runs
      of the benchmark's own trials, whose tables come with the package, and
      of yours
"""


def add(subparsers: Any, debug: argparse.ArgumentParser) -> None:
    """Add the command to the command line; `debug` is what all commands share."""
    plot = subparsers.add_parser(
        "plot",
        parents=[debug],
        epilog=EXAMPLES,
        help="draw figures of any set of trials",
        description="Draw the leaderboard's figures of finished trials, and the learning curve "
        "of every training that is named itself.",
    )
    plot.add_argument(
        "paths",
        nargs="*",
        type=Path,
        metavar="RUNS",
        help="folders of trials, single trials, folders of a leaderboard's tables, or published "
        "(default: that of --runs)",
    )
    add_runs(plot)
    plot.add_argument(
        "--out", type=Path, default=Path("figures"), metavar="FOLDER", help="folder (default figures)"
    )
    plot.add_argument(
        "--format",
        nargs="+",
        default=["png"],
        dest="formats",
        metavar="KIND",
        help="png, svg, pdf, or several of them (default png)",
    )
    plot.set_defaults(call=_call, runs=None)


def _call(args: argparse.Namespace) -> None:
    """Draw figures of any set of trials."""
    runs = runs_or(args.paths, args.runs)
    tell_watcher("reading the records, then drawing: some seconds, up to a minute for a whole grid")
    from usbench.figures import plots

    def tell(sentence: str) -> None:
        print(f"left out: {sentence}", file=sys.stderr)

    for path in plots.write(args.paths or [runs], args.out, args.formats, tell):
        print(path)
