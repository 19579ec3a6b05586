"""`usbench frame`: write one B-mode frame, envelope or RF."""

from __future__ import annotations

import argparse
import contextlib
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from usbench.checks import ConfigurationError
from usbench.cli.arguments import add_probe_and_imaging, number, probe_and_imaging, tell_watcher
from usbench.cli.phantom import add_phantom, custom_anatomy

if TYPE_CHECKING:
    from usbench.watch.snapshot_option import Source

# What errors name, by the option that gives it.
OPTIONS = {
    "x_mm": "--x",
    "focal_depth_mm": "--depth",
    "angle_deg": "--angle",
    "frequency_mhz": "--frequency",
    "dynamic_range_db": "--dynamic-range",
    "pixel_mm": "--pixel",
    "median_size": "--median",
    "phantom": "--number",
}
EXAMPLES = """examples:
  usbench frame --x 10 --depth 35 --angle 60
  usbench frame --x 10 --depth 35 --angle 60 --plain --out frame.png
      the 90 x 40 pixels of 1 mm that an agent sees
  usbench frame --depth 37 --rf --out rf.npy
  usbench frame --depth 37 --iq --out iq.uff
      for USTB or pyuff_ustb, with the geometry of probe and lines
  usbench frame --task setup --frequency 3 --dynamic-range 40
  usbench frame --task pp-random --number 7 --angle 30
      the phantom of an episode, whose records name it
  usbench defaults probe > probe.toml; usbench frame --probe probe.toml
      with another probe, once you have changed the fields of probe.toml
  usbench frame --depth 30 --probe l7-4
      with a probe of usbench list
  usbench frame --depth 30 --probe l7-4 --scatterers points.csv --pixel 0.1
      of points of your own, a table of x_mm, y_mm, z_mm and amplitude
  usbench frame --angle 30 --phantom spine.mha frames=recorded
      of a custom anatomy (docs/anatomy.md)
"""


def add(subparsers: Any, debug: argparse.ArgumentParser) -> None:
    """Add the command to the command line; `debug` is what all commands share."""
    frame = subparsers.add_parser(
        "frame",
        parents=[debug],
        epilog=EXAMPLES,
        help="what the probe sees from a pose, as a picture or as numbers",
        description="Write what the probe sees of a task's phantom, or of a 3-D image, from a pose: the "
        "B-mode frame, its envelope or its RF, as a figure to scale (.png) or as numbers (.npy, .npz, .uff).",
    )
    frame.add_argument("--x", type=number, default=0, metavar="MM", help="of the probe's centre (default 0)")
    frame.add_argument("--depth", type=number, default=50, metavar="MM", help="of the focus (default 50)")
    frame.add_argument(
        "--angle", type=number, default=0, metavar="DEG", help="clockwise from above (default 0)"
    )
    frame.add_argument(
        "--frequency", type=number, metavar="MHZ", help="centre frequency (default: the probe's)"
    )
    frame.add_argument(
        "--dynamic-range",
        type=number,
        metavar="DB",
        help="shown below the maximum (default: as the task shows it, mostly 60)",
    )
    frame.add_argument("--task", metavar="NAME", help="whose phantom (default: that of fp and pp)")
    frame.add_argument(
        "--number",
        type=number,
        metavar="N",
        help="which phantom of a task with many, from 2147483648 on those of the evaluation (default 0)",
    )
    kind = frame.add_mutually_exclusive_group()
    kind.add_argument("--rf", action="store_const", const="rf", dest="kind", help="RF of the scan lines")
    kind.add_argument(
        "--envelope", action="store_const", const="envelope", dest="kind", help="envelope of the scan lines"
    )
    kind.add_argument(
        "--iq", action="store_const", const="iq", dest="kind", help="I/Q of the scan lines, as numbers"
    )
    add_phantom(frame)
    frame.add_argument(
        "--scatterers",
        type=Path,
        metavar="FILE",
        help="a .csv or .npz of scatterers in place of the phantom: x, y, z (m) or x_mm, y_mm, z_mm, and "
        "amplitude",
    )
    add_probe_and_imaging(frame)
    frame.add_argument(
        "--pixel",
        type=number,
        metavar="MM",
        help="edge of a pixel (default: as the task has it, mostly 1; 0.2 for --scatterers)",
    )
    frame.add_argument(
        "--median",
        type=number,
        metavar="N",
        help="edge of the median filter in pixels (default: as the task has it, mostly 5; 1, which is none, "
        "for --scatterers)",
    )
    frame.add_argument("--plain", action="store_true", help="the bare pixels, without axes")
    frame.add_argument(
        "--out",
        type=Path,
        metavar="FILE",
        help=".png, .npy, .npz (with x and z), or .uff, which needs usbench[uff] (default: a .png named "
        "after the pose); --iq has no .png and needs one of the others",
    )
    frame.set_defaults(call=_call, kind="frame")


def _call(args: argparse.Namespace) -> None:
    """Write what the probe sees from a pose."""
    tell_watcher("simulating the frame, then drawing it: some seconds")
    from usbench.watch import snapshot, snapshot_files, snapshot_option

    source = _source(args)
    place = (args.x, args.depth, args.angle)
    with _named_by_options():
        source = replace(source, imaging=snapshot_option.imaging_of(source, args.pixel, args.median))
        source, pose = snapshot_option.placed(source, *place, args.frequency, args.dynamic_range)
    path = snapshot_files.path(args.out, args.kind, source, pose, plain=args.plain)
    taken = snapshot.take(source, pose, args.kind)
    snapshot_files.write(taken, path, plain=args.plain)
    print(f"{path}: {taken.kind}, {taken.values.shape} {taken.values.dtype}, {taken.unit}")


@contextlib.contextmanager
def _named_by_options() -> Iterator[None]:
    """Let errors begin with the option that gave the wrong value."""
    try:
        yield
    except ConfigurationError as error:
        name, _, rest = str(error).partition(" ")
        raise ConfigurationError(f"{OPTIONS.get(name, name)} {rest}") from error


def _source(args: argparse.Namespace) -> Source:
    """Return what is examined, and with what."""
    from usbench.envs.anatomy.points import read_points
    from usbench.watch import snapshot_option

    given = [name for name in ("phantom", "scatterers") if getattr(args, name)]
    if len(given) > 1:
        raise ConfigurationError("--phantom and --scatterers exclude each other: leave one of them out.")
    if given and (args.task, args.number) != (None, None):
        raise ConfigurationError(
            f"--{given[0]} is in place of a task's phantom: leave out --task and --number."
        )
    parts = probe_and_imaging(args)
    if args.scatterers:
        points = read_points(args.scatterers, tell=lambda text: print(text, file=sys.stderr))
        return snapshot_option.Source(points, points.label, **parts)
    usual = snapshot_option.usual_imaging(args.task)
    parts = {"usual": usual, "imaging": usual, **parts}
    if anatomy := custom_anatomy(args.phantom, looking=True):
        path, *settings = args.phantom
        return snapshot_option.Source(anatomy, "-".join([Path(path).name.split(".")[0], *settings]), **parts)
    label = snapshot_option.label(args.task, args.number)
    with _named_by_options():
        phantom = snapshot_option.phantom_of(args.task, args.number)
    return snapshot_option.Source(phantom, label, **parts)
