"""`usbench leaderboard`: write a leaderboard again."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Collection
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from usbench.checks import ConfigurationError
from usbench.cli.arguments import LEADERBOARD, add_leaderboard_file, tell_watcher

if TYPE_CHECKING:
    from usbench.results.additions import Addition
    from usbench.results.tables import Results

LEFT_OUT = "left out, as its anatomy, probe, imaging, reward or senses are not those of the task {}: {}"
KEPT = "the tables keep their trials: --replace puts those of {} in their place"
ANOTHER_STUDY = (
    "--replace puts the added one in its place, and added trials in the place of those with other numbers."
)
FORGOTTEN = "its score on unseen phantoms was of the older agent and is removed: {}"
FROM_THE_PACKAGE = "no tables in {}: those of the benchmark's own leaderboard are copied there"


def add(subparsers: Any, debug: argparse.ArgumentParser) -> None:
    """Add the command to the command line; `debug` is what all commands share."""
    leaderboard = subparsers.add_parser(
        "leaderboard",
        parents=[debug],
        help="write a leaderboard again, from its tables, from every trial in a folder, or from both",
        description="Write the leaderboard, its table of scores and the figures again, from the tables that "
        "compare left in the folder beside it (leaderboard_files), of several comparisons together, or with "
        "more trials; no trial is run. Where there are no tables, --add adds to those of the benchmark's own "
        "leaderboard, which come with the package.",
    )
    source = leaderboard.add_mutually_exclusive_group()
    source.add_argument(
        "--runs",
        type=Path,
        metavar="FOLDER",
        help="folder with trials: read all of them, whatever compare read",
    )
    source.add_argument(
        "--add", type=Path, metavar="FOLDER", help="folder with trials: add them to those of the tables"
    )
    leaderboard.add_argument(
        "--replace",
        action="store_true",
        help="with --add: a trial that the tables have with other numbers, or another study of one name, "
        "takes the place of theirs (default: the tables keep their trials)",
    )
    leaderboard.add_argument(
        "--search",
        type=Path,
        metavar="FOLDER",
        help="folder with the records of searches, for example search: tell how hard each row is to tune",
    )
    add_leaderboard_file(
        leaderboard,
        "leaderboard.md; with --runs below that folder where that would lose other trials, as in a clone",
    )
    leaderboard.set_defaults(call=_call, leaderboard=None)


def _call(args: argparse.Namespace) -> None:
    """Write a leaderboard and its figures again: of its tables, of a folder's trials, or of both.

    Raises:
        ConfigurationError: If options do not go together, or trials cannot be added.
    """
    if args.replace and args.add is None:
        raise ConfigurationError("--replace says what becomes of added trials: give their folder with --add.")
    tell_watcher(
        "reading the records, then drawing 30 figures and counting intervals: minutes for a whole grid"
    )
    from usbench.figures import comparison, tuning
    from usbench.results import leaderboard, tables
    from usbench.results.protocol import tuning as searched

    path = args.leaderboard or LEADERBOARD
    # Before anything is written: there may be no such record.
    search = None if args.search is None else searched.gather(args.search)
    if args.runs is not None:
        path = _write_trials(args)
    elif args.add is not None:
        _add_trials(args, path)
    folder = leaderboard.files(path)
    known = tables.read(folder)
    if search is not None:
        searched.write(search, folder)
    # First: the page shows those that there are.
    figures = [*comparison.write(known, folder), *tuning.write(searched.read(folder), folder)]
    for written in [*leaderboard.write(folder, path), *figures]:
        print(written)


def _write_trials(args: argparse.Namespace) -> Path:
    """Write the tables of the trials in a folder; return the leaderboard that they are of."""
    from usbench.compare import runs
    from usbench.results import leaderboard, studies

    known = _gathered(args.runs)
    # Before anything is written: a record of a study may be damaged.
    played = studies.gather(args.runs)
    tell = partial(print, file=sys.stderr)
    names = known.trials["trial"]
    path = runs.place(LEADERBOARD, args.runs, names, tell, named=args.leaderboard, with_studies=True)
    folder = leaderboard.prepare(path)
    runs.write_tables(known, folder)
    studies.write(played, folder)
    return path


def _add_trials(args: argparse.Namespace, path: Path) -> None:
    """Add the trials in a folder to the tables of the leaderboard `path`, and tell what became of them."""
    from usbench.records.lock import locked
    from usbench.results import additions, held_out, leaderboard, sources, studies, tables

    known, played = _gathered(args.add), studies.gather(args.add)
    folder = leaderboard.files(path)
    # Before anything is written: it may be refused.
    try:
        studies.add(studies.read(sources.own_or_published(folder)), played, replace=args.replace)
    except ConfigurationError as error:
        raise ConfigurationError(f"{error} {ANOTHER_STUDY}") from error
    additions.add(tables.read(sources.own_or_published(folder)), known)
    leaderboard.prepare(path)
    with locked(folder / tables.TRIALS):
        addition = additions.add(tables.read(sources.own_or_published(folder)), known, replace=args.replace)
        studied = studies.add(studies.read(sources.own_or_published(folder)), played, replace=args.replace)
        doubted = additions.unverified(folder) if args.replace else ()
        checked = _told(addition, args.add, replaced=args.replace, doubted=doubted)
        if sources.bring_published(folder):
            print(FROM_THE_PACKAGE.format(folder), file=sys.stderr)
        if args.replace:
            for name in held_out.forget(folder, [one.trial for one in addition.other]):
                print(FORGOTTEN.format(name), file=sys.stderr)
        # The marks first: a trial that is not verified is never there without its mark.
        additions.mark_unverified(folder, checked, [name for name, told in checked.items() if told])
        tables.write(addition.results, folder)
        studies.write(studied, folder)


def _gathered(folder: Path) -> Results:
    """Return the results of the trials in a folder, and tell which cannot be compared."""
    # Only here: the tables of a leaderboard need no simulator.
    from usbench.compare import runs

    known, others = runs.gather(folder)
    for name, task in others[["trial", "task"]].itertuples(index=False, name=None):
        print(LEFT_OUT.format(task, name), file=sys.stderr)
    return known


def _told(
    addition: Addition, runs: Path, *, replaced: bool, doubted: Collection[str]
) -> dict[str, list[str]]:
    """Tell what became of the trials in `runs`.

    Returns:
        Of each trial that is new, or new with these numbers, or was `doubted`, why it is not verified.
    """
    from usbench import records
    from usbench.compare import submission

    if addition.same or addition.other:
        n = len(addition.same) + len(addition.other)
        print(f"in the tables already, with the same numbers: {len(addition.same)} of {n}", file=sys.stderr)
    for one in addition.other:
        both = f"score {one.known:.5f} there, {one.added:.5f} in {runs}"
        print(f"in the tables already, with other numbers ({both}): {one.trial}", file=sys.stderr)
    if addition.other and not replaced:
        print(KEPT.format(runs), file=sys.stderr)
    for name, row in addition.apart.items():
        print(f"with other settings than its algorithm's row, so in the row {row!r}: {name}", file=sys.stderr)
    places = {folder.name: folder for folder in records.trial_folders(runs)}
    # A trial of the tables may have a folder of another name here, which is no other trial.
    asked = [*addition.new, *(name for name in addition.same if name in doubted and name in places)]
    checked = {name: submission.problems(places[name], records_alone=True) for name in asked}
    for name, told in checked.items():
        if told:
            print(f"not verified, and marked so: {name} ({told[0]})", file=sys.stderr)
    return checked
