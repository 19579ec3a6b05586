"""How far the frames of two kinds of processors differ: those of this processor and those of a plain one.

Vectors of another length round sums otherwise, and a pixel between two grey levels may fall to either. The
plain processor is this processor without newer instructions, in the simulator's code, in NumPy and in
OpenBLAS. The comparison takes some minutes.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from usbench import suite
from usbench.envs.phantom import Phantom
from usbench.envs.pose import Pose
from usbench.envs.scanner import scan

TASKS = ("fp", "pp")


def plain() -> dict[str, str]:
    """Return the environment variables of a plain processor."""
    found = np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])
    return {
        "NUMBA_CPU_NAME": "generic",
        "NUMBA_CPU_FEATURES": "",
        "OPENBLAS_CORETYPE": "Nehalem",
        "NPY_DISABLE_CPU_FEATURES": " ".join(found),
    }


def simulate(path: Path) -> None:
    """Write the frames of all poses of each task."""
    states = {task: sorted(suite.TASKS[task].guidance.states, key=_focal_depth) for task in TASKS}
    np.savez(
        path, **{task: np.stack([scan(Phantom(), pose) for pose in poses]) for task, poses in states.items()}
    )


def _focal_depth(pose: Pose) -> int:
    """Return what responses are tabulated for: tables of four depths are kept."""
    return pose.focal_depth_mm


def main() -> None:
    """Print how many pixels differ."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--write", type=Path, help="only simulate the frames, and write them to this file")
    args = parser.parse_args()
    if args.write:
        simulate(args.write)
        return
    with tempfile.TemporaryDirectory() as folder:
        frames = []
        for name, variables in (("here", {}), ("plain", plain())):
            path = Path(folder) / f"{name}.npz"
            # Compiled code and tables are kept apart, since they are made by one kind of processor.
            own = {"NUMBA_CACHE_DIR": f"{folder}/{name}", "USBENCH_CACHE": f"{folder}/{name}-cache"}
            command = [sys.executable, __file__, "--write", str(path)]
            subprocess.run(command, env={**os.environ, **own, **variables}, check=True)
            frames.append(dict(np.load(path)))
    for task in TASKS:
        one, other = (each[task].astype(int) for each in frames)
        differ = one != other
        print(
            f"{task}: {differ.sum()} of {differ.size} pixels differ, in {differ.any(axis=(1, 2)).sum()} of "
            f"{len(one)} frames, by at most {abs(one - other).max()} of 255"
        )


if __name__ == "__main__":
    main()
