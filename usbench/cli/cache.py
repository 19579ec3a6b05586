"""`usbench cache`: show or clear the frames and the simulator's tables that are kept on disk."""

from __future__ import annotations

import argparse
import re
import shutil
import textwrap
from collections.abc import Sequence
from datetime import datetime
from typing import Any, NamedTuple

DAMAGED = "not readable"


class Kept(NamedTuple):
    """A file in words.

    Attributes:
        holds: How many frames, or a table; `DAMAGED` where it is not readable.
        size: In bytes.
        used: When it was used last, s.
        scene: What it was made from.
        is_foreign: Whether another version of the simulator made it.
    """

    holds: str
    size: int
    used: float
    scene: str = ""
    is_foreign: bool = False


def add(subparsers: Any, debug: argparse.ArgumentParser) -> None:
    """Add the command to the command line; `debug` is what all commands share."""
    cache = subparsers.add_parser(
        "cache",
        parents=[debug],
        help="show or clear the frames and the simulator's tables kept on disk",
        description="Show how many frames are kept on disk, and how many tables that the simulator makes "
        "them from, or clear them: they are made again when needed. USBENCH_CACHE sets their place.",
    )
    what = cache.add_mutually_exclusive_group()
    what.add_argument("--files", action="store_true", help="list every file and what it holds, too")
    what.add_argument("--clear", action="store_true", help="remove them")
    cache.set_defaults(call=_call)


def _call(args: argparse.Namespace) -> None:
    """Show or clear what is kept on disk."""
    if args.clear:
        clear_cache()
    else:
        print_cache(files=args.files)


def clear_cache() -> None:
    """Remove all frames and tables, and print how much that was."""
    from usbench.envs.cache import folder, frame_files, table_files

    removed = [kind.clear() for kind in (frame_files.FRAMES, table_files.TABLES)]
    n_files, size = (sum(column) for column in zip(*removed, strict=True))
    print(f"removed {_counted(n_files, 'file')} ({size / 1e6:.1f} MB) from {folder.cache_folder()}")


def print_cache(*, files: bool = False) -> None:
    """Print where files are kept and how much of the limits they take, and where `files`, what each holds."""
    from usbench.envs.cache import folder, frame_files, table_files

    frames, tables = _frames(), _tables()
    print(f"folder:         {folder.cache_folder()}")
    _print_sum("frames", frames, frame_files.MAX_BYTES)
    _print_sum("tables", tables, table_files.MAX_BYTES)
    if files:
        width = shutil.get_terminal_size().columns
        for one in (*frames, *tables):
            print(_described(one, width))


def _print_sum(name: str, found: Sequence[Kept], limit: int) -> None:
    """Print how many files there are, what they take of `limit` bytes, and how many of them are of no use."""
    size = sum(one.size for one in found) / 1e6
    print(f"{name + ':':16}{_counted(len(found), 'file')}, {size:.1f} MB of at most {limit / 1e6:.0f} MB")
    foreign, damaged = sum(one.is_foreign for one in found), sum(one.holds == DAMAGED for one in found)
    if foreign:
        print(f"{'':16}{foreign} of another version of the simulator, which this one does not use")
    if damaged:
        print(f"{'':16}{damaged} {DAMAGED}")


def _described(one: Kept, width: int) -> str:
    """Return what a file is, in a line, and what it was made from below, in lines of `width` characters."""
    used = datetime.fromtimestamp(one.used).isoformat(" ", "minutes")
    foreign = ", of another version of the simulator" if one.is_foreign else ""
    first = f"{one.holds}, {one.size / 1e6:.1f} MB, last used {used}{foreign}"
    indent = " " * 4
    below = textwrap.wrap(_readable(one.scene), width, initial_indent=indent, subsequent_indent=indent)
    return "\n".join([first, *below])


def _frames() -> list[Kept]:
    """Return the files of frames, the one used last first."""
    from usbench.envs.cache import frame_files
    from usbench.envs.frames import SIMULATOR

    return [
        Kept(DAMAGED, one.size, one.used)
        if (held := one.contents) is None
        else Kept(
            holds=_counted(len(held.frames), "frame"),
            size=one.size,
            used=one.used,
            scene=held.scene,
            is_foreign=held.simulator != SIMULATOR,
        )
        for one in frame_files.entries()
    ]


def _tables() -> list[Kept]:
    """Return the files of tables, the one used last first."""
    from usbench.envs.cache import table_files

    return [
        Kept(DAMAGED, one.size, one.used)
        if (held := one.contents) is None
        else Kept("a table", one.size, one.used, held.scene, is_foreign=held.code != table_files.CODE)
        for one in table_files.entries()
    ]


def _readable(scene: str) -> str:
    """Return what a file holds with `LinearArray()` as "default array", and numbers of four digits."""
    listed = re.sub(r"\) (?=[A-Z])", "), ", scene)
    named = re.sub(r"\w*([A-Z])(\w+)\(\)", lambda name: f"default {name[1].lower()}{name[2]}", listed)
    return re.sub(r"\b\d+\.\d+(e-?\d+)?\b", lambda number: f"{float(number[0]):.4g}", named)


def _counted(number: int, what: str) -> str:
    return f"{number} {what}{'s' * (number != 1)}"
