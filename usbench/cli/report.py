"""`usbench report`: put everything about a set of trials on one page."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from usbench.cli.arguments import add_runs, runs_or, tell_watcher, teller


def add(subparsers: Any, debug: argparse.ArgumentParser) -> None:
    """Add the command to the command line; `debug` is what all commands share."""
    report = subparsers.add_parser(
        "report",
        parents=[debug],
        help="put everything about a set of trials on one page",
        description="Write one HTML file that works offline: leaderboard, figures, a replay and a map of the "
        "actions for each agent and task, look-alike poses, how episodes end, configuration.",
    )
    report.add_argument(
        "path",
        nargs="?",
        type=Path,
        metavar="RUNS",
        help="folder of trials, or a single trial or study (default: that of --runs)",
    )
    add_runs(report)
    report.add_argument(
        "--out", type=Path, default=Path("report.html"), metavar="FILE", help=".html (default report.html)"
    )
    report.add_argument("--quiet", action="store_true", help="no progress")
    report.set_defaults(call=_call, runs=None)


def _call(args: argparse.Namespace) -> None:
    """Write the page of a set of trials."""
    runs = runs_or(args.path, args.runs)
    tell_watcher(
        "reading the records, then drawing: some seconds for each agent, minutes for a whole grid", args.quiet
    )
    from usbench.report import page

    tell = teller(args.quiet)
    path = page.write(args.path or runs, args.out, tell)
    print(f"{path}: {path.stat().st_size / 1e6:.1f} MB")
