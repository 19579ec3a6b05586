"""What all commands' arguments have in common: how they are refused and what they are read as."""

import argparse
import contextlib
import sys
import textwrap
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn

from usbench.checks import ConfigurationError, did_you_mean

REFUSED = 2
# The leaderboard of the grid.
LEADERBOARD = Path("leaderboard.md")
# Said after Ctrl-C of commands that keep what they have done.
GOES_ON = "what was recorded is kept: the same command goes on from there."


class Help(argparse.RawDescriptionHelpFormatter):
    """Breaks lines to the width of the terminal, and no name at its hyphens; examples keep their lines."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        if "\n" in text:
            return super()._fill_text(text, width, indent)
        return textwrap.fill(
            text, width, initial_indent=indent, subsequent_indent=indent, break_on_hyphens=False
        )

    def _split_lines(self, text: str, width: int) -> list[str]:
        return textwrap.wrap(" ".join(text.split()), width, break_on_hyphens=False)


class Parser(argparse.ArgumentParser):
    """Refuses in one sentence, without the usage text."""

    def __init__(self, **kwargs: Any) -> None:
        """Takes argparse's arguments."""
        super().__init__(allow_abbrev=False, formatter_class=Help, **kwargs)

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """Refuse a value that is none of the choices, as of an unknown command, with the closest of them."""
        try:
            super()._check_value(action, value)
        except argparse.ArgumentError as error:
            error.message += did_you_mean(value, list(action.choices or ()))
            raise

    def refuse(self, rest: Sequence[str]) -> NoReturn:
        """Refuse the arguments that nothing takes, with the closest option if the first of them is one."""
        first = rest[0].partition("=")[0]
        if first.startswith("-"):
            hint = did_you_mean(first, self._option_string_actions, cutoff=0.7)
        else:
            # There may be several where the shell makes folders of runs/pp-*.
            hint = f": {self.prog} takes {self._arguments()}"
        self.error(f"unrecognized arguments: {' '.join(rest)}{hint}")

    def _arguments(self) -> str:
        """Return in words what this command takes beside the values of its options."""
        named = self._get_positional_actions()
        if not named:
            names = [action.option_strings[-1] for action in self._actions if action.dest != "help"]
            return f"options alone ({', '.join(names)})"
        if named[0].nargs in (None, "?"):
            return f"one argument ({named[0].metavar})"
        return f"all of its arguments ({named[0].metavar}) before its options"

    def error(self, message: str) -> NoReturn:
        """Exit with the status of what is refused."""
        # What was typed may hold line breaks.
        self.exit(REFUSED, f"usbench: error: {' '.join(message.split())} (see {self.prog} --help)\n")


def number(text: str) -> int | float | str:
    """Return a number where `text` is one; what is allowed is decided where the value is used."""
    for kind in (int, float):
        with contextlib.suppress(ValueError):
            return kind(text)
    return text


def setting(text: str) -> tuple[str, str]:
    """Return name and value of "name=value"."""
    name, separator, value = text.partition("=")
    if not (name and separator and value):
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form name=value")
    return name, value


def each_once(option: str, pairs: Sequence[tuple[str, str]]) -> dict[str, str]:
    """Return the pairs of an option as a dictionary; ConfigurationError if a name is there twice."""
    for name, count in Counter(name for name, _ in pairs).items():
        if count > 1:
            raise ConfigurationError(f"{option} takes {name} once, not {count} times.")
    return dict(pairs)


def add_leaderboard_file(parser: argparse.ArgumentParser, default: str = str(LEADERBOARD)) -> None:
    """Add the option for the file of the leaderboard; `default` says in words where it is without one."""
    parser.add_argument(
        "--leaderboard",
        type=_file,
        default=LEADERBOARD,
        metavar="FILE",
        help=f"file to write (default {default})",
    )


def _file(text: str) -> Path:
    """Return the path of a leaderboard, which need not be there; a folder is none."""
    if Path(text).is_dir():
        raise argparse.ArgumentTypeError(
            f"must be a file, for example {LEADERBOARD}, not the folder {text!r}"
        )
    if Path(text).suffix != LEADERBOARD.suffix:
        raise argparse.ArgumentTypeError(f"must end with {LEADERBOARD.suffix}, not {text!r}")
    return Path(text)


def tell_watcher(text: str, quiet: bool = False) -> None:
    """Say on stderr what is being done, where a person waits for it; files and pipes get results alone."""
    if sys.stderr.isatty() and not quiet:
        print(text, file=sys.stderr, flush=True)


def teller(quiet: bool) -> Callable[[str], None]:
    """Return what says on stderr what is being done; nothing if `quiet`."""

    def tell(text: str) -> None:
        if not quiet:
            print(text, file=sys.stderr, flush=True)

    return tell


def add_runs(parser: argparse.ArgumentParser, what: str = "folder with trials") -> None:
    """Add the option for the folder of trials that a command reads; `--out` is what it writes."""
    parser.add_argument(
        "--runs", type=Path, default=Path("runs"), metavar="FOLDER", help=f"{what} (default runs)"
    )


def runs_or(named: Any, runs: Path | None) -> Path:
    """Return the folder of `--runs`, "runs" by default; ConfigurationError if RUNS is `named` besides."""
    if runs is not None and named:
        raise ConfigurationError("RUNS is in place of --runs: leave one of them out.")
    return runs or Path("runs")


def add_sweep(parser: argparse.ArgumentParser) -> None:
    """Add the options of commands that run several trials."""
    parser.add_argument(
        "--jobs",
        type=number,
        metavar="N",
        help="trials at a time (default: USBENCH_THREADS, or all cores; on a cluster all at once)",
    )
    parser.add_argument(
        "--out", type=Path, default=Path("runs"), metavar="FOLDER", help="folder for trials (default runs)"
    )
    parser.add_argument("--quiet", action="store_true", help="no progress")


def add_senses(parser: argparse.ArgumentParser, where: str = "") -> None:
    """Add the option for what agents are told beside the frames; `where` says in words on which tasks."""
    parser.add_argument(
        "--senses",
        nargs="*",
        metavar="SENSE",
        help=f"what the agent is told beside the frames{where}: position, focus, heading, actions "
        "(default: the task's own, most tasks have none)",
    )


def add_probe_and_imaging(parser: argparse.ArgumentParser) -> None:
    """Add the options for another probe and another imaging than the default ones."""
    parser.add_argument(
        "--probe",
        type=Path,
        metavar="NAME_OR_FILE",
        help="a probe of usbench list, or a TOML file with fields of the probe "
        "(usbench defaults probe > probe.toml writes one)",
    )
    parser.add_argument(
        "--imaging",
        type=Path,
        metavar="FILE",
        help="a TOML file with fields of the imaging (usbench defaults imaging > imaging.toml writes one)",
    )


def probe_and_imaging(args: argparse.Namespace) -> "dict[str, Any]":
    """Return the `probe` and the `imaging` of the options that are given, as `Setting` takes them.

    Raises:
        ConfigurationError: If a file cannot be used; one sentence says why.
    """
    from usbench.setting_parts import toml_files

    return {
        kind: read(path)
        for kind, read in (("probe", toml_files.read_probe), ("imaging", toml_files.read_imaging))
        if (path := getattr(args, kind)) is not None
    }
