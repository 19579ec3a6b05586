"""`usbench cache`: show or clear the frames and the simulator's tables that are kept on disk."""

from __future__ import annotations

import argparse
import re
from datetime import datetime
from typing import Any


def add(subparsers: Any, debug: argparse.ArgumentParser) -> None:
    """Add the command to the command line; `debug` is what all commands share."""
    cache = subparsers.add_parser(
        "cache",
        parents=[debug],
        help="show or clear the frames and the simulator's tables kept on disk",
        description="Show the frames kept on disk and the tables that the simulator makes them from, or "
        "clear them: they are made again when needed. USBENCH_CACHE sets their place.",
    )
    cache.add_argument("--clear", action="store_true", help="remove them")
    cache.set_defaults(call=_call)


def _call(args: argparse.Namespace) -> None:
    """Show or clear what is kept on disk."""
    if args.clear:
        clear_cache()
    else:
        print_cache()


def clear_cache() -> None:
    """Remove all frames and tables, and print how much that was."""
    from usbench.envs.cache import folder, frame_files, table_files

    removed = [kind.clear() for kind in (frame_files.FRAMES, table_files.TABLES)]
    n_files, size = (sum(column) for column in zip(*removed, strict=True))
    print(f"removed {n_files} file{'s' * (n_files != 1)} ({size / 1e6:.1f} MB) from {folder.cache_folder()}")


def print_cache() -> None:
    """Print where files are kept, how much of the limits they take, and what each file holds."""
    from rich.console import Console
    from rich.table import Table

    from usbench.envs import frames
    from usbench.envs.cache import folder, frame_files, table_files

    print(f"folder:         {folder.cache_folder()}")
    of_frames, of_tables = frame_files.entries(), table_files.entries()
    for name, entries, limit in (
        ("frames", of_frames, frame_files.MAX_BYTES),
        ("tables", of_tables, table_files.MAX_BYTES),
    ):
        size = sum(entry.size for entry in entries)
        counted = f"{len(entries)} file{'s' * (len(entries) != 1)}"
        print(f"{name + ':':16}{counted}, {size / 1e6:.1f} MB of at most {limit / 1e6:.0f} MB")
    shown = Table()
    for name in ("holds", "size", "last used", "simulator", "phantom, array, imaging; or table of"):
        shown.add_column(name, overflow="fold")
    damaged = ["not readable", "", ""]
    for entry in of_frames:
        row = damaged
        if (held := entry.contents) is not None:
            row = [
                _counted(len(held.frames)),
                _made_by(held.simulator == frames.SIMULATOR),
                _readable(held.scene),
            ]
        shown.add_row(row[0], *_size_and_use(entry), *row[1:])
    for one in of_tables:
        row = damaged
        if (table := one.contents) is not None:
            row = ["a table", _made_by(table.code == table_files.CODE), _readable(table.scene)]
        shown.add_row(row[0], *_size_and_use(one), *row[1:])
    if of_frames or of_tables:
        Console().print(shown)


def _readable(scene: str) -> str:
    """Return what a file holds with `LinearArray()` as "default array", and numbers of four digits."""
    listed = re.sub(r"\) (?=[A-Z])", "), ", scene)
    named = re.sub(r"\w*([A-Z])(\w+)\(\)", lambda name: f"default {name[1].lower()}{name[2]}", listed)
    return re.sub(r"\b\d+\.\d+(e-?\d+)?\b", lambda number: f"{float(number[0]):.4g}", named)


def _counted(n_frames: int) -> str:
    return f"{n_frames} frame{'s' * (n_frames != 1)}"


def _made_by(this: bool) -> str:
    return "this" if this else "another"


def _size_and_use(entry: Any) -> tuple[str, str]:
    return f"{entry.size / 1e6:.1f} MB", datetime.fromtimestamp(entry.used).isoformat(" ", "minutes")
