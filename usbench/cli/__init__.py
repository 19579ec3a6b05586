"""The command line: arguments in, exit status out."""

import argparse
import contextlib
import logging
import os
import signal
import sys
import threading
import warnings
from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import version
from typing import Any

from usbench.checks import as_configuration_error
from usbench.cli import (
    cache,
    compare,
    defaults,
    frame,
    guide,
    leaderboard,
    list,
    plot,
    report,
    run,
    search,
    transfer,
    watch,
)
from usbench.cli.arguments import REFUSED, Parser
from usbench.cli.sharing import dataset, submit
from usbench.words import in_one_line

# As a shell tells of programs that end by SIGINT and by SIGPIPE: 128 and the signal's number.
DONE, FAILED, INTERRUPTED, UNREAD = 0, 1, 130, 141
# As `usbench --help` lists them.
COMMANDS = (
    run,
    compare,
    leaderboard,
    submit,
    transfer,
    search,
    frame,
    watch,
    plot,
    guide,
    report,
    dataset,
    list,
    defaults,
    cache,
)

EXAMPLES = """examples:
  usbench run --algo vpg --task pp
  usbench run --algo vpg --task fp --noise 0.25 --seed 3
  usbench run --algo vpg --task pp --preset spinup --set gamma=0.95 --out mine
  usbench compare --tasks pp --noise 0 --seeds 2 --steps 1024
  usbench run --algo dqn --task exam --reward image
  usbench compare --algos vpg dqn --tasks pp pp-random --noise 0
  usbench transfer
  usbench leaderboard
  usbench frame --x 10 --depth 35 --angle 60
  usbench guide
  usbench watch best:pp
  usbench watch runs/pp-p0-vpg-s0-f5fd15c6
  usbench plot runs --out figures --format svg
  usbench report
  usbench dataset --task pp --agent best --episodes 1000
  usbench list
  usbench cache --clear
"""


def build_parser() -> tuple[Parser, Mapping[str, Parser]]:
    """Return the parser of the whole command line, and those of the commands by name."""
    parser = Parser(
        prog="usbench",
        description="Reinforcement learning for ultrasound probe guidance, with exact anchors.",
        epilog=EXAMPLES,
    )
    parser.add_argument("--version", action="version", version=f"usbench {version('usbench')}")
    subparsers = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    debug = Parser(add_help=False)
    debug.add_argument("--debug", action="store_true", help="show the traceback of an error")

    for command in COMMANDS:
        command.add(subparsers, debug)
    return parser, subparsers.choices


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv`; return 0 if done, 1 if it failed, 2 if refused, 130 if interrupted.

    Where the reader of the output has gone (`usbench list | head -1`), nobody is left to be told: the command
    ends without a word, and 141 is returned.
    """
    try:
        return _run(argv)
    except (BrokenPipeError, SystemExit) as error:
        # Rich makes a SystemExit of the error.
        if not isinstance(error, BrokenPipeError) and not isinstance(error.__context__, BrokenPipeError):
            raise
        return UNREAD
    finally:
        _drop_unwritten()


def _run(argv: Sequence[str] | None) -> int:
    """Run the command line `argv` and return its exit status; BrokenPipeError if nobody reads its output."""
    try:
        args = _parsed(argv)
    except SystemExit as exit_:
        return int(exit_.code or 0)
    try:
        plain = contextlib.nullcontext() if args.debug else _plain_warnings()
        with _terminable(), _own_modules(), _telling(quiet=getattr(args, "quiet", False)), plain:
            _check_threads()
            args.call(args)
            print(end="", flush=True)  # there may be no output at all
    except KeyboardInterrupt:
        how = getattr(args, "interrupted", "")
        kept = f", {how}" if how else "."
        print(f"usbench: interrupted{kept}", file=sys.stderr)
        if getattr(args, "ends_at_once", False):
            # Python would wait for the threads, which may simulate for seconds.
            sys.stderr.flush()
            os._exit(INTERRUPTED)
        return INTERRUPTED
    except Exception as error:
        if args.debug or isinstance(error, BrokenPipeError):
            raise
        from usbench.records import ConfigurationError, TrialError

        # As may be in the code of one's own algorithm.
        where = " (--debug shows where)" if isinstance(error, TrialError) else ""
        print(f"usbench: error: {_sentence(error)}{where}", file=sys.stderr)
        # Whoever names a folder or file that is not there is told so, as of any other wrong value.
        return REFUSED if isinstance(error, (ConfigurationError, FileNotFoundError)) else FAILED
    return DONE


def _sentence(error: Exception) -> str:
    """Return what an error says in one line; of one of the operating system the file, too, not its number."""
    if not isinstance(error, OSError) or error.strerror is None:
        return in_one_line(error)
    what = "reading or writing failed"
    if error.filename is not None:
        what = f"{os.fsdecode(error.filename)!r} cannot be read or written"
    return f"{what} ({error.strerror})."


def _drop_unwritten() -> None:
    """Let vanish what no stream takes any more: Python would try once more when it ends, and complain."""
    for stream in filter(None, (sys.stdout, sys.stderr)):
        try:
            stream.flush()
        except OSError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _parsed(argv: Sequence[str] | None) -> argparse.Namespace:
    parser, commands = build_parser()
    args, rest = parser.parse_known_args(argv)
    if rest:
        commands[args.command].refuse(rest)
    return args


def _check_threads() -> None:
    """Refuse a number of threads that cannot be, also where nothing would be computed with it."""
    if "USBENCH_THREADS" in os.environ:
        # Only then, as few commands need the simulator.
        from usbench.envs.threads import n_threads

        with as_configuration_error():
            n_threads()


@contextlib.contextmanager
def _telling(quiet: bool) -> Iterator[None]:
    """Write to the standard error what takes long and how long, unless the command is `quiet`."""
    log = logging.getLogger("usbench.waiting")
    handler, level = _BesideBars(), log.level
    if not quiet:
        log.addHandler(handler)
        log.setLevel(logging.INFO)
    try:
        yield
    finally:
        log.removeHandler(handler)
        log.setLevel(level)


@contextlib.contextmanager
def _plain_warnings() -> Iterator[None]:
    """Show what is meant for users as a sentence, once, without the line of the source that warns of it."""
    usual, said = warnings.formatwarning, set()

    def plain(message: Warning | str, category: type[Warning], *where: Any, **more: Any) -> str:
        if category is not UserWarning:
            return usual(message, category, *where, **more)
        sentence = f"usbench: {message}\n"
        if sentence in said:  # Python counts it anew for each line of the source
            return ""
        said.add(sentence)
        return sentence

    warnings.formatwarning = plain
    try:
        yield
    finally:
        warnings.formatwarning = usual


class _BesideBars(logging.Handler):
    """Messages on lines above bars of progress, which take over `sys.stderr` while they are drawn."""

    def emit(self, record: logging.LogRecord) -> None:
        """Write one."""
        with contextlib.suppress(OSError):  # nobody may read it any more: what is running goes on
            print(self.format(record), file=sys.stderr, flush=True)


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
    """Let SIGTERM, and the end of the terminal, end a command as Ctrl-C does, with its state kept.

    A signal that is ignored, as by nohup, stays so. Only the main thread hears signals.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    numbers = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
    before = {number: signal.getsignal(number) for number in numbers}
    heard = {number: handler for number, handler in before.items() if handler != signal.SIG_IGN}
    for number in heard:
        signal.signal(number, signal.default_int_handler)
    try:
        yield
    finally:
        for number, handler in heard.items():
            signal.signal(number, handler)
