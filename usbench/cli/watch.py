"""`usbench watch`: replay evaluation episodes of a trial."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from usbench.cli.arguments import number, tell_watcher

EXAMPLES = """examples:
  usbench watch best:pp
      a trained agent that comes with the package
  usbench watch runs/pp-p0-vpg-s0-f5fd15c6
      in the terminal; as a table of text where the output is no terminal
  usbench watch runs/pp-p0-vpg-s0-f5fd15c6 --episode 0 17 --out episodes.mp4
      many episodes: an .mp4 is written picture by picture, and Pillow holds a
      .gif or .webp whole
  usbench watch runs/pp-p0-vpg-s0-f5fd15c6 --sampled --out episode.gif
"""


def add(subparsers: Any, debug: argparse.ArgumentParser) -> None:
    """Add the command to the command line; `debug` is what all commands share."""
    watch = subparsers.add_parser(
        "watch",
        parents=[debug],
        epilog=EXAMPLES,
        help="replay evaluation episodes of a trial",
        description="Replay episodes of a trial's last evaluation: scene and frame, action, reward, return "
        "beside that of the optimum in the same episode, and what the saved agent advises.",
    )
    watch.add_argument(
        "trial",
        type=Path,
        metavar="TRIAL",
        help="folder of a trial, or an agent that comes with the package: best:TASK, vpg:fp, vpg:pp",
    )
    watch.add_argument(
        "--episode",
        nargs="+",
        type=number,
        default=[],
        metavar="N",
        help="numbers of evaluation episodes (default: the one whose return is the median)",
    )
    watch.add_argument(
        "--sampled", action="store_true", help="episodes with sampled actions in place of greedy ones"
    )
    watch.add_argument("--out", type=Path, metavar="FILE", help=".gif, .webp or .mp4 (default: the terminal)")
    watch.set_defaults(call=_call)


def _call(args: argparse.Namespace) -> None:
    """Replay evaluation episodes of a trial."""
    tell_watcher("opening the trial and its agent: some seconds")
    from usbench.watch import selection, terminal

    out = args.out if args.out is None else selection.check_file(args.out)
    chosen = selection.choose(args.trial, args.episode, sampled=args.sampled)
    if chosen.ask is None:
        print(f"without advice: {chosen.silence}", file=sys.stderr)
    if out is None:
        terminal.show(chosen)
    else:
        selection.write(chosen, out)
        print(out)
