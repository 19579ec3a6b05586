"""`usbench search`: search hyperparameters of an algorithm."""

from __future__ import annotations

import argparse
from typing import Any

from usbench.cli.arguments import GOES_ON, add_sweep, number

EXAMPLES = """examples:
  usbench search --algo ppo
  usbench search --algo dqn --tasks pp --noise 0 --steps 8032 --candidates 10 --jobs 8
  usbench search --algo ppo --tasks pp --steps 8192 --candidates 8 --finalists 3
      many candidates on little, then the best three on both of the paper's tasks, two seeds, the whole budget

The same command goes on where it was stopped. Seeds begin at 1000, where no comparison has any.
"""


def add(subparsers: Any, debug: argparse.ArgumentParser) -> None:
    """Add the command to the command line; `debug` is what all commands share."""
    search = subparsers.add_parser(
        "search",
        parents=[debug],
        epilog=EXAMPLES,
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
        help="number of best candidates to train again, on the paper's tasks with other seeds (default 0)",
    )
    add_sweep(search)
    search.set_defaults(call=_call, interrupted=GOES_ON)


def _call(args: argparse.Namespace) -> None:
    """Search hyperparameters of one algorithm."""
    from usbench.cli.output import sweep_output
    from usbench.compare import plan, search
    from usbench.envs.threads import n_threads

    jobs = n_threads() if args.jobs is None else plan.positive("jobs", args.jobs)
    settings = search.settings_of(args.algo, args.tasks, noise=args.noise, seeds=args.seeds, steps=args.steps)
    n_candidates = plan.positive("candidates", args.candidates)
    n_finalists = 0 if args.finalists is None else plan.positive("finalists", args.finalists)
    with sweep_output.SweepBars(args.quiet) as bars:
        print(search.run(settings, n_candidates, args.out, bars, n_finalists, jobs=jobs))
