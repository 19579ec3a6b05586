"""`usbench cache`: show or clear the frames kept on disk."""

from __future__ import annotations

import argparse
from datetime import datetime
from typing import Any


def add(subparsers: Any, debug: argparse.ArgumentParser) -> None:
    """Add the command to the command line; `debug` is what all commands share."""
    cache = subparsers.add_parser(
        "cache",
        parents=[debug],
        help="show or clear the frames kept on disk",
        description="Show the frames kept on disk, or clear them: they are simulated again when needed. "
        "USBENCH_CACHE sets their place.",
    )
    cache.add_argument("--clear", action="store_true", help="remove them")
    cache.set_defaults(call=_call)


def _call(args: argparse.Namespace) -> None:
    """Show or clear the frames kept on disk."""
    from usbench.envs import frame_files

    if args.clear:
        n_files, size = frame_files.clear()
        removed = f"{n_files} file{'s' * (n_files != 1)} ({size / 1e6:.1f} MB)"
        print(f"removed {removed} from {frame_files.cache_folder()}")
    else:
        print_cache()


def print_cache() -> None:
    """Print where frames are kept, how much of the limit they take, and what each file holds."""
    from rich.console import Console
    from rich.table import Table

    from usbench.envs import frame_files, frames

    entries = frame_files.entries()
    print(f"folder:         {frame_files.cache_folder()}")
    size, limit = sum(entry.size for entry in entries), frame_files.MAX_BYTES / 1e6
    print(f"files:          {len(entries)}, {size / 1e6:.1f} MB of at most {limit:.0f} MB")
    table = Table()
    for name in ("frames", "size", "last used", "simulator", "phantom, array, imaging"):
        table.add_column(name, overflow="fold")
    for entry in entries:
        row = ["not readable", "", ""]
        if entry.contents is not None:
            this = entry.contents.simulator == frames.SIMULATOR
            row = [str(len(entry.contents.frames)), "this" if this else "another", entry.contents.scene]
        used = datetime.fromtimestamp(entry.used).isoformat(" ", "minutes")
        table.add_row(row[0], f"{entry.size / 1e6:.1f} MB", used, *row[1:])
    if entries:
        Console().print(table)
