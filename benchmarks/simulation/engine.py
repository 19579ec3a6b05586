"""Frames of one engine, timed on demand, so that two engines can take turns: see `simulator.py`.

Reads focal depths in mm from the standard input, one a line, and writes for each the seconds of the first
frame (which makes the table of responses, as no folder keeps it) and the median of `N_FRAMES` further ones.
It uses names alone that the engine of an earlier commit has, too.
"""

from __future__ import annotations

import statistics
import sys
import time

from usbench.envs.phantom import Phantom
from usbench.envs.pose import Pose
from usbench.envs.scanner import scan

N_FRAMES = 15


def seconds(phantom: Phantom, depth_mm: int) -> float:
    """Return the wall time of a frame."""
    start = time.perf_counter()
    scan(phantom, Pose(0, depth_mm))
    return time.perf_counter() - start


def main() -> None:
    """Answer until the input ends."""
    phantom = Phantom()
    scan(phantom, Pose(0, 45))  # draws the phantom, compiles
    for line in sys.stdin:
        first, *others = (seconds(phantom, int(line)) for _ in range(1 + N_FRAMES))
        print(first, statistics.median(others), flush=True)


if __name__ == "__main__":
    main()
