"""`usbench guide`: move the probe in the browser, with advice."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

from usbench.cli.arguments import add_probe_and_imaging, number, probe_and_imaging

EXAMPLES = """examples:
  usbench guide
  usbench guide runs/pp-p0-vpg-s0-f5fd15c6 --noise 0.25
  usbench guide --task fp --port 8000 --no-browser
  usbench guide --probe probe.toml --imaging imaging.toml

Nobody but this machine can reach the page. From elsewhere: ssh -L 8000:127.0.0.1:8000 HOST
"""


def add(subparsers: Any, debug: argparse.ArgumentParser) -> None:
    """Add the command to the command line; `debug` is what all commands share."""
    guide = subparsers.add_parser(
        "guide",
        parents=[debug],
        epilog=EXAMPLES,
        help="move the probe yourself, in the browser, with an agent's advice",
        description="Serve a page on which you move the probe, or watch an agent do it, with the agent's "
        "advice and the optimum beside; needs usbench[guide]. Ctrl-C ends it.",
    )
    guide.add_argument(
        "trial", type=Path, nargs="?", metavar="TRIAL", help="folder of a trial (default: the best in --runs)"
    )
    guide.add_argument("--task", metavar="NAME", help="task to begin with (default: the trial's, or pp)")
    guide.add_argument("--noise", type=number, metavar="P", help="0..1 (default: the trial's, or 0)")
    add_probe_and_imaging(guide)
    guide.add_argument(
        "--seed", type=number, metavar="N", help="seed of the episodes (default: a random one)"
    )
    guide.add_argument(
        "--runs", type=Path, default=Path("runs"), metavar="DIR", help="folder with trials (default runs)"
    )
    guide.add_argument("--port", type=number, default=0, metavar="N", help="(default: a free one)")
    guide.add_argument("--no-browser", action="store_true", help="print the address, open nothing")
    guide.set_defaults(call=_call)


def _call(args: argparse.Namespace) -> None:
    """Serve the page on which a person moves the probe, until Ctrl-C."""
    from usbench.cli.output import trial_output
    from usbench.guide import server
    from usbench.guide.session import Session
    from usbench.tasks import PAPER

    with server.listening(args.port) as listener:
        own = {"task": args.task, "noise": args.noise, **probe_and_imaging(args)}
        session = Session(args.runs, args.trial, seed=args.seed, **own)
        bars = trial_output.Bars()
        # Of other tasks there are thousands: they are simulated as the probe moves.
        for task in sorted({*session.tasks} & {*PAPER}):
            replace(session.setting, task=task).prepare_frames(bars.frames)
        bars.close()
        server.serve(session, listener, browser=not args.no_browser)
