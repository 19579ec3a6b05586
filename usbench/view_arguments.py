"""The arguments of the commands that look: frame, watch, guide, plot, report, list and cache."""

import argparse
from pathlib import Path
from typing import Any

from usbench import commands
from usbench.arguments import number, phantom

FRAME_EXAMPLES = """examples:
  usbench frame --x 10 --depth 35 --angle 60
  usbench frame --x 10 --depth 35 --angle 60 --plain --out frame.png
      the 90 x 40 pixels of 1 mm that an agent sees
  usbench frame --depth 37 --rf --out rf.npy
  usbench frame --task setup --frequency 3 --dynamic-range 40
  usbench frame --task pp-random --number 7 --angle 30
      the phantom of an episode, whose records name it
  usbench frame --angle 30 --phantom spine.mha frames=recorded
      of a volume of your own (docs/anatomy.md)
"""

WATCH_EXAMPLES = """examples:
  usbench watch runs/pp-p0-vpg-s0-f5fd15c6
      in the terminal; as a table of text where the output is no terminal
  usbench watch runs/pp-p0-vpg-s0-f5fd15c6 --episode 0 17 --out episodes.mp4
  usbench watch runs/pp-p0-vpg-s0-f5fd15c6 --drawn --out episode.gif
"""

GUIDE_EXAMPLES = """examples:
  usbench guide
  usbench guide runs/pp-p0-vpg-s0-f5fd15c6 --noise 0.25
  usbench guide --task fp --port 8000 --no-browser

Nobody but this machine can reach the page. From elsewhere: ssh -L 8000:127.0.0.1:8000 HOST
"""

PLOT_EXAMPLES = """examples:
  usbench plot
      the leaderboard's figures of all trials in runs
  usbench plot runs/pp-p0-vpg-s0-f5fd15c6 --format png svg pdf
      of one trial, with its learning curve
  usbench plot leaderboard_files --out paper --format pdf
      from the tables that compare left
"""


def add(subparsers: Any, debug: argparse.ArgumentParser) -> None:
    """Add the commands to the command line; `debug` is what all commands share."""
    _add_frame(subparsers, debug)
    _add_watch(subparsers, debug)
    _add_guide(subparsers, debug)
    _add_plot(subparsers, debug)
    _add_report(subparsers, debug)
    _add_list(subparsers, debug)
    _add_cache(subparsers, debug)


def _add_frame(subparsers: Any, debug: argparse.ArgumentParser) -> None:
    frame = subparsers.add_parser(
        "frame",
        parents=[debug],
        epilog=FRAME_EXAMPLES,
        help="what the probe sees from a pose, as a picture or as numbers",
        description="Write what the probe sees of a task's phantom, or of a 3-D image, from a pose: the "
        "B-mode frame, its envelope or its RF, as a figure to scale (.png) or as numbers (.npy).",
    )
    frame.add_argument("--x", type=number, default=0, metavar="MM", help="of the probe's centre (default 0)")
    frame.add_argument("--depth", type=number, default=50, metavar="MM", help="of the focus (default 50)")
    frame.add_argument(
        "--angle", type=number, default=0, metavar="DEG", help="clockwise from above (default 0)"
    )
    frame.add_argument("--frequency", type=number, metavar="MHZ", help="centre frequency (default 3.5)")
    frame.add_argument(
        "--dynamic-range", type=number, metavar="DB", help="shown below the maximum (default 60)"
    )
    frame.add_argument("--task", metavar="NAME", help="whose phantom (default: that of fp and pp)")
    frame.add_argument(
        "--number",
        type=number,
        metavar="N",
        help="which phantom of a task with many, from 2147483648 on those of the evaluation (default 0)",
    )
    kind = frame.add_mutually_exclusive_group()
    kind.add_argument("--rf", action="store_const", const="rf", dest="kind", help="RF of the 64 lines")
    kind.add_argument(
        "--envelope", action="store_const", const="envelope", dest="kind", help="envelope of the 64 lines"
    )
    phantom(frame)
    frame.add_argument("--plain", action="store_true", help="the bare pixels, without axes")
    frame.add_argument(
        "--out", type=Path, metavar="FILE", help=".png or .npy (default: a .png named after the pose)"
    )
    frame.set_defaults(call=commands.frame, kind="frame")


def _add_watch(subparsers: Any, debug: argparse.ArgumentParser) -> None:
    watch = subparsers.add_parser(
        "watch",
        parents=[debug],
        epilog=WATCH_EXAMPLES,
        help="replay evaluation episodes of a trial",
        description="Replay episodes of a trial's last evaluation: scene and frame, action, reward, return "
        "beside the optimum's in the same episode, and what the saved agent advises.",
    )
    watch.add_argument("trial", type=Path, metavar="TRIAL", help="folder of a trial")
    watch.add_argument(
        "--episode",
        nargs="+",
        type=number,
        default=[],
        metavar="N",
        help="numbers of evaluation episodes (default: the one whose return is the median)",
    )
    watch.add_argument(
        "--drawn", action="store_true", help="episodes with drawn actions instead of the most probable ones"
    )
    watch.add_argument("--out", type=Path, metavar="FILE", help=".gif, .webp or .mp4 (default: the terminal)")
    watch.set_defaults(call=commands.watch)


def _add_guide(subparsers: Any, debug: argparse.ArgumentParser) -> None:
    guide = subparsers.add_parser(
        "guide",
        parents=[debug],
        epilog=GUIDE_EXAMPLES,
        help="move the probe yourself, in the browser, with an agent's advice",
        description="Serve a page on which you move the probe, or watch an agent do it, with the agent's "
        "advice and the optimum beside; needs usbench[guide]. Ctrl-C ends it.",
    )
    guide.add_argument(
        "trial", type=Path, nargs="?", metavar="TRIAL", help="folder of a trial (default: the best in --runs)"
    )
    guide.add_argument("--task", metavar="NAME", help="task to begin with (default: the trial's, or pp)")
    guide.add_argument("--noise", type=number, metavar="P", help="0..1 (default: the trial's, or 0)")
    guide.add_argument("--seed", type=number, metavar="N", help="of the episodes (default: drawn)")
    guide.add_argument(
        "--runs", type=Path, default=Path("runs"), metavar="DIR", help="folder with trials (default runs)"
    )
    guide.add_argument("--port", type=number, default=0, metavar="N", help="(default: a free one)")
    guide.add_argument("--no-browser", action="store_true", help="print the address, open nothing")
    guide.set_defaults(call=commands.guide)


def _add_plot(subparsers: Any, debug: argparse.ArgumentParser) -> None:
    plot = subparsers.add_parser(
        "plot",
        parents=[debug],
        epilog=PLOT_EXAMPLES,
        help="draw figures of any set of trials",
        description="Draw the leaderboard's figures of finished trials, and the learning curve "
        "of every trial that is named itself.",
    )
    plot.add_argument(
        "runs",
        nargs="*",
        type=Path,
        default=[Path("runs")],
        metavar="RUNS",
        help="folders of trials, single trials, or the folder of a leaderboard's tables (default runs)",
    )
    plot.add_argument("--out", type=Path, default=Path("figures"), help="folder (default figures)")
    plot.add_argument(
        "--format",
        nargs="+",
        default=["png"],
        dest="formats",
        metavar="KIND",
        help="png, svg, pdf, or several of them (default png)",
    )
    plot.set_defaults(call=commands.plot)


def _add_report(subparsers: Any, debug: argparse.ArgumentParser) -> None:
    report = subparsers.add_parser(
        "report",
        parents=[debug],
        help="put everything about a set of trials on one page",
        description="Write one HTML file that works offline: leaderboard, figures, a replay and a map of the "
        "actions for each agent and task, look-alike poses, how episodes end, configuration.",
    )
    report.add_argument(
        "runs",
        nargs="?",
        type=Path,
        default=Path("runs"),
        metavar="RUNS",
        help="folder of trials, or a single trial (default runs)",
    )
    report.add_argument(
        "--out", type=Path, default=Path("report.html"), metavar="FILE", help=".html (default report.html)"
    )
    report.add_argument("--quiet", action="store_true", help="no progress")
    report.set_defaults(call=commands.report)


def _add_list(subparsers: Any, debug: argparse.ArgumentParser) -> None:
    show = subparsers.add_parser("list", parents=[debug], help="show tasks, algorithms and their defaults")
    show.set_defaults(call=commands.show_suite)


def _add_cache(subparsers: Any, debug: argparse.ArgumentParser) -> None:
    cache = subparsers.add_parser(
        "cache",
        parents=[debug],
        help="show or clear the frames kept on disk",
        description="Show the frames kept on disk, or clear them: they are simulated again when needed. "
        "USBENCH_CACHE sets their place.",
    )
    cache.add_argument("--clear", action="store_true", help="remove them")
    cache.set_defaults(call=commands.cache)
