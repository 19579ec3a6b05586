"""The commands: arguments in, exit status out. What they do stands in the modules that they call.

Those are imported when a command runs, so that `usbench --help` does not wait for torch.
"""

import argparse
import contextlib
import os
import signal
import sys
from collections.abc import Iterator, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any, NoReturn

DONE, FAILED, REFUSED, INTERRUPTED = 0, 1, 2, 130

EXAMPLES = """examples:
  usbench run --algo vpg --task pp
  usbench run --algo vpg --task fp --noise 0.25 --seed 3
  usbench run --algo vpg --task pp --preset spinup --set gamma=0.95 --out my_runs
  usbench list
  usbench cache --clear
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
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    debug = _Parser(add_help=False)
    debug.add_argument("--debug", action="store_true", help="show the traceback of an error")

    run = commands.add_parser(
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
    run.add_argument("--quiet", action="store_true", help="no progress")
    run.set_defaults(call=_run)

    show = commands.add_parser("list", parents=[debug], help="show tasks, algorithms and their defaults")
    show.set_defaults(call=_list)

    cache = commands.add_parser(
        "cache",
        parents=[debug],
        help="show or clear the frames kept on disk",
        description="Show the frames kept on disk, or clear them: they are simulated again when needed. "
        "USBENCH_CACHE sets their place.",
    )
    cache.add_argument("--clear", action="store_true", help="remove them")
    cache.set_defaults(call=_cache)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv`; return 0 if done, 1 if it failed, 2 if refused, 130 if interrupted."""
    try:
        args = build_parser().parse_args(argv)
    except SystemExit as exit_:
        return int(exit_.code or 0)
    try:
        with _terminable():
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


def _run(args: argparse.Namespace) -> None:
    from usbench import console, plots, replay, runner, training

    config = runner.resolve(
        args.algo,
        args.task,
        noise=args.noise,
        seed=args.seed,
        steps=args.steps,
        preset=args.preset,
        overrides=dict(args.set),
    )
    progress: training.Progress = training.Silent() if args.quiet else console.Bars()
    try:
        result = runner.run_trial(config, args.out, overwrite=args.overwrite, progress=progress)
    finally:
        progress.close()
    if result.skipped:
        print("This trial is finished already; here are its results (--overwrite runs it again).")
    figures = {
        "learning curve": plots.learning_curve(result.folder),
        "replay": replay.write_gif(result.folder),
    }
    console.print_trial(result.folder, figures)


def _list(args: argparse.Namespace) -> None:
    from usbench import console

    console.print_suite()


def _cache(args: argparse.Namespace) -> None:
    from usbench import console
    from usbench.envs import cache

    if args.clear:
        n_files, size = cache.clear()
        print(
            f"removed {n_files} file{'s' * (n_files != 1)} ({size / 1e6:.1f} MB) from {cache.cache_folder()}"
        )
    else:
        console.print_cache()


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
def _terminable() -> Iterator[None]:
    """Let SIGTERM end a command as Ctrl-C does, with its state kept."""
    previous = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, previous)
