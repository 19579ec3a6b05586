"""The command line: arguments in, exit status out."""

import argparse
import contextlib
import os
import signal
import sys
from collections.abc import Iterator, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any, NoReturn

from usbench import commands

DONE, FAILED, REFUSED, INTERRUPTED = 0, 1, 2, 130

EXAMPLES = """examples:
  usbench run --algo vpg --task pp
  usbench run --algo vpg --task fp --noise 0.25 --seed 3
  usbench run --algo vpg --task pp --preset spinup --set gamma=0.95 --out my_runs
  usbench compare --tasks pp --noise 0 --seeds 2 --steps 1024
  usbench leaderboard
  usbench frame --x 10 --depth 35 --angle 60
  usbench watch runs/pp-p0-vpg-s0-4bb5b115
  usbench plot runs --out figures --format svg
  usbench report
  usbench list
  usbench cache --clear
"""

COMPARE_EXAMPLES = """examples:
  usbench compare
      the paper's grid: vpg, a2c, ppo and dqn on both tasks with three noise levels and 4 seeds
  usbench compare --algos vpg ppo --tasks pp --noise 0 --seeds 10 --jobs 8
  usbench compare --steps 1024 --seeds 2 --out quick --leaderboard quick/leaderboard.md
      a minute's try
  usbench compare --cluster tcp://host:8786
      on the workers of a Dask cluster (docs/scaling.md)

What is finished is not run again, so the same command goes on after an interruption.
"""

FRAME_EXAMPLES = """examples:
  usbench frame --x 10 --depth 35 --angle 60
  usbench frame --x 10 --depth 35 --angle 60 --plain --out frame.png
      the 90 x 40 pixels of 1 mm that an agent sees
  usbench frame --depth 37 --rf --out rf.npy
"""

WATCH_EXAMPLES = """examples:
  usbench watch runs/pp-p0-vpg-s0-4bb5b115
      in the terminal; as a table of text where the output is no terminal
  usbench watch runs/pp-p0-vpg-s0-4bb5b115 --episode 0 17 --out episodes.mp4
  usbench watch runs/pp-p0-vpg-s0-4bb5b115 --drawn --out episode.gif
"""

PLOT_EXAMPLES = """examples:
  usbench plot
      the leaderboard's figures of all trials in runs
  usbench plot runs/pp-p0-vpg-s0-4bb5b115 --format png svg pdf
      of one trial, with its learning curve
  usbench plot leaderboard_files --out paper --format pdf
      from the tables that compare left
"""

GUIDE_EXAMPLES = """examples:
  usbench guide
  usbench guide runs/pp-p0-vpg-s0-4bb5b115 --noise 0.25
  usbench guide --task fp --port 8000 --no-browser

Nobody but this machine can reach the page. From elsewhere: ssh -L 8000:127.0.0.1:8000 HOST
"""

SEARCH_EXAMPLES = """examples:
  usbench search --algo ppo
  usbench search --algo dqn --tasks pp --noise 0 --steps 8032 --candidates 10 --jobs 8

The same command goes on where it was stopped. Seeds begin at 1000, where no comparison has any.
"""


class _Parser(argparse.ArgumentParser):
    """Refuses in one sentence, without the usage text."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(allow_abbrev=False, formatter_class=argparse.RawDescriptionHelpFormatter, **kwargs)

    def error(self, message: str) -> NoReturn:
        self.exit(REFUSED, f"usbench: error: {message} (see {self.prog} --help)\n")


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of the whole command line."""
    parser = _Parser(
        prog="usbench",
        description="Reinforcement learning for ultrasound probe guidance, with exact anchors.",
        epilog=EXAMPLES,
    )
    parser.add_argument("--version", action="version", version=f"usbench {version('usbench')}")
    subparsers = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    debug = _Parser(add_help=False)
    debug.add_argument("--debug", action="store_true", help="show the traceback of an error")

    run = subparsers.add_parser(
        "run",
        parents=[debug],
        epilog=EXAMPLES,
        help="train and evaluate one agent on one task",
        description="Train and evaluate one agent on one task; leave records, learning curve and replay.",
    )
    run.add_argument("--algo", required=True, help="algorithm, for example vpg (see usbench list)")
    run.add_argument("--task", required=True, help="task, fp or pp (see usbench list)")
    run.add_argument("--noise", type=_number, default=0.0, metavar="P", help="probability 0..1 (default 0)")
    run.add_argument("--seed", type=_number, default=0, metavar="N", help="trial seed (default 0)")
    run.add_argument("--steps", type=_number, metavar="N", help="training steps (default: the task's budget)")
    run.add_argument("--preset", metavar="NAME", help="named hyperparameters, for example spinup")
    run.add_argument(
        "--set",
        action="extend",
        nargs="+",
        type=_setting,
        default=[],
        metavar="NAME=VALUE",
        help="hyperparameters, for example n_value_steps=80",
    )
    run.add_argument("--out", type=Path, default=Path("runs"), help="folder for trials (default runs)")
    run.add_argument("--overwrite", action="store_true", help="run again even if finished")
    run.add_argument(
        "--wandb", action="store_true", help="let Weights & Biases follow the training; needs usbench[wandb]"
    )
    run.add_argument("--quiet", action="store_true", help="no progress")
    run.set_defaults(call=commands.run)

    _add_compare(subparsers, debug)
    _add_leaderboard(subparsers, debug)
    _add_search(subparsers, debug)
    _add_frame(subparsers, debug)
    _add_watch(subparsers, debug)
    _add_guide(subparsers, debug)
    _add_plot(subparsers, debug)
    _add_report(subparsers, debug)
    show = subparsers.add_parser("list", parents=[debug], help="show tasks, algorithms and their defaults")
    show.set_defaults(call=commands.show_suite)

    cache = subparsers.add_parser(
        "cache",
        parents=[debug],
        help="show or clear the frames kept on disk",
        description="Show the frames kept on disk, or clear them: they are simulated again when needed. "
        "USBENCH_CACHE sets their place.",
    )
    cache.add_argument("--clear", action="store_true", help="remove them")
    cache.set_defaults(call=commands.cache)
    return parser


def _add_compare(subparsers: Any, debug: argparse.ArgumentParser) -> None:
    compare = subparsers.add_parser(
        "compare",
        parents=[debug],
        epilog=COMPARE_EXAMPLES,
        help="compare algorithms and write a leaderboard",
        description="Run the trials that are missing, several at a time; write the leaderboard, "
        "scores.csv beside it, and tables and figures in a folder beside it. random, stay and oracle always "
        "take part.",
    )
    compare.add_argument(
        "--algos",
        nargs="+",
        default=["vpg", "a2c", "ppo", "dqn"],
        metavar="NAME",
        help="algorithms, also your own as module:name (default vpg a2c ppo dqn; see usbench list)",
    )
    compare.add_argument(
        "--tasks", nargs="+", default=["fp", "pp"], metavar="NAME", help="tasks (default fp pp)"
    )
    compare.add_argument(
        "--noise",
        nargs="+",
        type=_number,
        default=[0.0, 0.25, 0.5],
        metavar="P",
        help="probabilities 0..1 (default 0 0.25 0.5)",
    )
    compare.add_argument("--seeds", type=_number, default=4, metavar="N", help="number of seeds (default 4)")
    compare.add_argument(
        "--steps", type=_number, metavar="N", help="training steps (default: the task's budget)"
    )
    _add_leaderboard_file(compare)
    _add_sweep(compare)
    compare.add_argument(
        "--cluster",
        metavar="ADDRESS",
        help="run the trials on a Dask cluster, for example tcp://host:8786; needs usbench[dask]",
    )
    compare.set_defaults(call=commands.compare)


def _add_leaderboard(subparsers: Any, debug: argparse.ArgumentParser) -> None:
    leaderboard = subparsers.add_parser(
        "leaderboard",
        parents=[debug],
        help="write a leaderboard again, from its tables alone",
        description="Write the leaderboard, scores.csv beside it and the figures again, from the tables that "
        "compare left in the folder beside it (leaderboard_files); no trial is run or read.",
    )
    _add_leaderboard_file(leaderboard)
    leaderboard.set_defaults(call=commands.leaderboard)


def _add_leaderboard_file(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--leaderboard",
        type=Path,
        default=Path("leaderboard.md"),
        metavar="FILE",
        help="file to write (default leaderboard.md)",
    )


def _add_search(subparsers: Any, debug: argparse.ArgumentParser) -> None:
    search = subparsers.add_parser(
        "search",
        parents=[debug],
        epilog=SEARCH_EXAMPLES,
        help="search hyperparameters of an algorithm",
        description="Try hyperparameters of one algorithm and write a table; needs usbench[search].",
    )
    search.add_argument("--algo", required=True, help="algorithm, for example ppo (see usbench list)")
    search.add_argument(
        "--tasks", nargs="+", default=["fp", "pp"], metavar="NAME", help="tasks (default fp pp)"
    )
    search.add_argument("--noise", type=_number, default=0.25, metavar="P", help="0..1 (default 0.25)")
    search.add_argument(
        "--seeds", type=_number, default=1, metavar="N", help="seeds per candidate (default 1)"
    )
    search.add_argument(
        "--steps", type=_number, metavar="N", help="training steps (default: the task's budget)"
    )
    search.add_argument(
        "--candidates", type=_number, default=20, metavar="N", help="candidates in all (default 20)"
    )
    _add_sweep(search)
    search.set_defaults(call=commands.search)


def _add_frame(subparsers: Any, debug: argparse.ArgumentParser) -> None:
    frame = subparsers.add_parser(
        "frame",
        parents=[debug],
        epilog=FRAME_EXAMPLES,
        help="what the probe sees from a pose, as a picture or as numbers",
        description="Write what the probe sees of the default phantom from a pose: the B-mode frame, its "
        "envelope or its RF, as a figure to scale (.png) or as numbers (.npy).",
    )
    frame.add_argument("--x", type=_number, default=0, metavar="MM", help="of the probe's centre (default 0)")
    frame.add_argument("--depth", type=_number, default=50, metavar="MM", help="of the focus (default 50)")
    frame.add_argument(
        "--angle", type=_number, default=0, metavar="DEG", help="clockwise from above (default 0)"
    )
    kind = frame.add_mutually_exclusive_group()
    kind.add_argument("--rf", action="store_const", const="rf", dest="kind", help="RF of the 64 lines")
    kind.add_argument(
        "--envelope", action="store_const", const="envelope", dest="kind", help="envelope of the 64 lines"
    )
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
        type=_number,
        default=[],
        metavar="N",
        help="numbers of evaluation episodes (default: the one whose return is the median)",
    )
    watch.add_argument(
        "--drawn", action="store_true", help="episodes with drawn actions instead of the most probable ones"
    )
    watch.add_argument("--out", type=Path, metavar="FILE", help=".gif or .mp4 (default: the terminal)")
    watch.set_defaults(call=commands.watch)


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
    guide.add_argument("--noise", type=_number, metavar="P", help="0..1 (default: the trial's, or 0)")
    guide.add_argument("--seed", type=_number, metavar="N", help="of the episodes (default: drawn)")
    guide.add_argument(
        "--runs", type=Path, default=Path("runs"), metavar="DIR", help="folder with trials (default runs)"
    )
    guide.add_argument("--port", type=_number, default=0, metavar="N", help="(default: a free one)")
    guide.add_argument("--no-browser", action="store_true", help="print the address, open nothing")
    guide.set_defaults(call=commands.guide)


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


def _add_sweep(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--jobs", type=_number, metavar="N", help="trials at a time (default: all cores)")
    parser.add_argument("--out", type=Path, default=Path("runs"), help="folder for trials (default runs)")
    parser.add_argument("--quiet", action="store_true", help="no progress")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv`; return 0 if done, 1 if it failed, 2 if refused, 130 if interrupted."""
    try:
        args = build_parser().parse_args(argv)
    except SystemExit as exit_:
        return int(exit_.code or 0)
    try:
        with _terminable(), _own_modules():
            args.call(args)
            sys.stdout.flush()
    except KeyboardInterrupt:
        print("usbench: interrupted, what was recorded is kept.", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:
        # The reader has gone (`usbench list | head`): nobody is left to be told.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    except Exception as error:
        if args.debug:
            raise
        from usbench.records import ConfigurationError

        print(f"usbench: error: {' '.join(str(error).split())}", file=sys.stderr)
        return REFUSED if isinstance(error, ConfigurationError) else FAILED
    return DONE


def _number(text: str) -> int | float | str:
    """Return a number where `text` is one; what is allowed is decided where the value is used."""
    for kind in (int, float):
        with contextlib.suppress(ValueError):
            return kind(text)
    return text


def _setting(text: str) -> tuple[str, str]:
    name, separator, value = text.partition("=")
    if not (name and separator and value):
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form name=value")
    return name, value


@contextlib.contextmanager
def _own_modules() -> Iterator[None]:
    """Let a command import algorithms of the user's own from the folder where it runs."""
    folder = os.getcwd()
    sys.path.append(folder)
    try:
        yield
    finally:
        sys.path.remove(folder)


@contextlib.contextmanager
def _terminable() -> Iterator[None]:
    """Let SIGTERM end a command as Ctrl-C does, with its state kept."""
    previous = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, previous)
