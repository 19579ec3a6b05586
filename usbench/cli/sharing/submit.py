"""`usbench submit`: check trials of your own, and put together what the leaderboard needs of them."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from usbench.cli.arguments import teller

EXAMPLES = """examples:
  usbench compare --algos mine:LongPPO --out mine \\
      --leaderboard mine/leaderboard.md
  usbench submit mine
      checks the trials in mine, writes the folder submission (docs/submit.md)
  usbench submit submission --check
      checks again, and writes nothing
"""


def add(subparsers: Any, debug: argparse.ArgumentParser) -> None:
    """Add the command to the command line; `debug` is what all commands share."""
    submit = subparsers.add_parser(
        "submit",
        parents=[debug],
        epilog=EXAMPLES,
        help="check trials of your own for the leaderboard, and put them together",
        description="Check trials from their records alone (seeds, budget, environment, frames, every "
        "evaluation played again from its actions), and copy what the leaderboard needs of them; no code of "
        "an algorithm runs.",
    )
    submit.add_argument("trials", type=Path, metavar="TRIALS", help="folder of trials, or a single trial")
    submit.add_argument(
        "--out", type=Path, default=Path("submission"), metavar="FOLDER", help="folder (default submission)"
    )
    submit.add_argument("--check", action="store_true", help="check, and write nothing")
    submit.add_argument("--quiet", action="store_true", help="no progress")
    submit.set_defaults(call=_call)


def _call(args: argparse.Namespace) -> None:
    """Check the trials; copy them if none has a problem."""
    from usbench.compare import submission

    tell = teller(args.quiet)
    if not args.check:
        _check_place(args.trials, args.out)
    found = submission.check(args.trials, tell)
    wrong = {folder.name: told for folder, told in found.items() if told}
    if wrong:
        name, told = next(iter(wrong.items()))
        counted = "the trial is" if len(found) == 1 else f"{len(wrong)} of {len(found)} trials are"
        raise RuntimeError(f"{counted} not verified, nothing is written; {name}: {' '.join(told)}")
    for told_of_frames in submission.other_frames(list(found), tell):
        print(told_of_frames, file=sys.stderr)
    print(f"verified: {len(found)} of {len(found)} trials")
    if not args.check:
        print(submission.write(list(found), args.out))


def _check_place(runs: Path, out: Path) -> None:
    """Raise ConfigurationError if `out` is a file, holds the trials in `runs`, or would hold others, too."""
    from usbench import records
    from usbench.checks import ConfigurationError

    if out.is_file():
        raise ConfigurationError(f"{str(out)!r} is a file: choose a folder with --out.")
    folders = {folder.name: folder for folder in (records.trial_folders(runs) if runs.is_dir() else [])}
    if any(folder.resolve() == (out / name).resolve() for name, folder in folders.items()):
        raise ConfigurationError(
            f"the trials are in the folder {str(out)!r} already: usbench submit {out} --check checks them."
        )
    others = [folder.name for folder in records.trial_folders(out) if folder.name not in folders]
    # Where there is no trial in `runs`, the check says so.
    if folders and others:
        raise ConfigurationError(
            f"the folder {str(out)!r} holds trials that are not in {str(runs)!r}, as {others[0]}: remove "
            "them, or choose another folder with --out."
        )
