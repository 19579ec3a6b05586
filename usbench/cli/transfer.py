"""`usbench transfer`: test agents of one phantom on unseen phantoms."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from usbench.checks import ConfigurationError
from usbench.cli.arguments import (
    GOES_ON,
    LEADERBOARD,
    add_leaderboard_file,
    add_runs,
    number,
    tell_watcher,
    teller,
)
from usbench.cli.leaderboard import FROM_THE_PACKAGE


def add(subparsers: Any, debug: argparse.ArgumentParser) -> None:
    """Add the command to the command line; `debug` is what all commands share."""
    transfer = subparsers.add_parser(
        "transfer",
        parents=[debug],
        help="test agents of one phantom on unseen phantoms",
        description="Test every agent of a comparison that was trained on one phantom (fp, pp) on the "
        "evaluation phantoms of the same task with many (fp-random, pp-random), and write the leaderboard "
        "with both side by side: usbench compare --tasks pp pp-random, then this. What was tested is not "
        "tested again, and what is not there is counted and left out. Trials of your own: "
        "usbench leaderboard --add runs, then this.",
    )
    transfer.add_argument(
        "--algos",
        nargs="+",
        metavar="NAME",
        help="only these (default: all but your own, module:name, whose code is run if they are named)",
    )
    transfer.add_argument(
        "--tasks",
        nargs="+",
        metavar="NAME",
        help="only agents of these tasks on one phantom (default: fp pp)",
    )
    transfer.add_argument(
        "--noise", nargs="+", type=number, metavar="P", help="only agents trained with these (default: all)"
    )
    add_runs(transfer, "folder with the comparison's trials")
    add_leaderboard_file(transfer, "leaderboard.md, begun with the benchmark's own tables where it has none")
    transfer.add_argument("--quiet", action="store_true", help="no progress")
    transfer.set_defaults(call=_call, interrupted=GOES_ON, leaderboard=None)


def _call(args: argparse.Namespace) -> None:
    """Test agents of one phantom on unseen phantoms, and write the leaderboard again."""
    tell_watcher("loading PyTorch: some seconds; then some for each trial and each new frame", args.quiet)
    # First, as PyTorch takes seconds.
    path = LEADERBOARD if args.leaderboard is None else _with_tables(args.leaderboard)
    from usbench.compare import transfer
    from usbench.records.lock import locked
    from usbench.results import held_out, leaderboard, sources, tables

    tell = teller(args.quiet)
    tested = sources.own_or_published(leaderboard.files(path))
    asked = {"algos": args.algos, "tasks": args.tasks, "noises": args.noise}
    missing = transfer.untested(args.runs, tested, **asked, tell=tell)
    folder = leaderboard.prepare(path)
    with locked(folder / tables.TRIALS):
        brought = sources.bring_published(folder)
    if brought:
        tell(FROM_THE_PACKAGE.format(folder))
    failures = transfer.write(args.runs, folder, missing, tell)
    for written in (folder / held_out.TABLE, *leaderboard.write(folder, path)):
        print(written)
    if failures:
        raise RuntimeError(f"{len(failures)} of {len(missing)} trials cannot be tested, as {failures[0]}")


def _with_tables(named: Path) -> Path:
    """Return the leaderboard that is named; ConfigurationError if it has no tables, as a misspelt one."""
    from usbench.results import leaderboard, tables

    folder = leaderboard.files(named)
    if not (folder / tables.TRIALS).exists():
        raise ConfigurationError(
            f"the leaderboard {str(named)!r} has no tables (there is no {tables.TRIALS} in {str(folder)!r}): "
            "usbench compare and usbench leaderboard --add write them."
        )
    return named
