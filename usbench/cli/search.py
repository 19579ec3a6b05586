"""`usbench search`: choose the hyperparameters of each row of the comparison, by the protocol."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from usbench.cli.arguments import GOES_ON, add_sweep, tell_watcher

if TYPE_CHECKING:
    from usbench.compare import protocol, search

EXAMPLES = """examples:
  usbench search --algo ppo
  usbench search
      every row of the protocol, one after the other
  usbench search --algo dqn --protocol mine.toml --records mine
      candidates, rungs and seeds of a protocol of yours (docs/protocol.md
      shows one)

The same command goes on where it was stopped, on another machine too if the
records are there.
"""


def add(subparsers: Any, debug: argparse.ArgumentParser) -> None:
    """Add the command to the command line; `debug` is what all commands share."""
    search = subparsers.add_parser(
        "search",
        parents=[debug],
        epilog=EXAMPLES,
        help="choose hyperparameters by the protocol",
        description="Train candidates of one algorithm or of all, round by round, by the protocol. The table "
        "of algorithms takes the winner, unless it was chosen by a protocol of yours.",
    )
    search.add_argument(
        "--algo", metavar="NAME", help="a row of the protocol's search, for example ppo (default: all)"
    )
    search.add_argument(
        "--protocol", type=Path, metavar="FILE", help="protocol (default: that of the benchmark)"
    )
    search.add_argument(
        "--records",
        type=Path,
        default=Path("search"),
        metavar="FOLDER",
        help="folder of the records, one file per row (default search)",
    )
    add_sweep(search)
    search.set_defaults(call=_call, interrupted=GOES_ON)


def _call(args: argparse.Namespace) -> None:
    """Search the hyperparameters of one row or of all."""
    tell_watcher("looking at the records of the search: some seconds", args.quiet)
    from usbench.cli.output import sweep_output
    from usbench.compare import plan, protocol, search
    from usbench.envs.threads import n_threads

    jobs = n_threads() if args.jobs is None else plan.positive("jobs", args.jobs)
    rules = protocol.read(protocol.PATH if args.protocol is None else args.protocol)
    rows = rules.search.rows if args.algo is None else [search.check_row(rules, args.algo)]
    for row in rows:
        with sweep_output.SweepBars(args.quiet) as bars:
            winner = search.run(row, rules, args.records, args.out / "search", bars, jobs=jobs)
        _tell(winner, rules)


def _tell(winner: search.Winner, rules: protocol.Protocol) -> None:
    """Print who has won, and what is to be done with it."""
    from usbench.agents.hyperparameters import as_set

    values = " ".join(as_set(winner.hyperparameters))
    print(f"{winner.row}: candidate {winner.candidate}, score {winner.score:.3f}: {values}")
    if not rules.is_of_the_package:
        command = f"usbench run --algo {winner.row} --task {rules.search.tasks[0]} --set {values}"
        print(f"The table of algorithms stays as it is.\nnext: {command}")
    sys.stdout.flush()
