"""Steps per second of every task with 1 and 16 environments: python benchmarks/vector.py (make bench-vector).

Gymnasium's own `benchmark_vector_step` counts the steps of random actions. Environments in step are beside
the same environments one after the other (Gymnasium's `SyncVectorEnv`), with the same seeds. Where a task has
one phantom, its frames are made first, unless they are kept on disk; a task with a new phantom in every
episode simulates them as it goes, and first makes the response tables of its focal depths.
"""

from __future__ import annotations

import argparse
import os
import platform

import gymnasium as gym
import numpy as np
from gymnasium.utils.performance import benchmark_vector_step

from usbench.envs.threads import n_threads
from usbench.setting import Setting
from usbench.tasks import BUILT_IN

NUM_ENVS = 16
MODES = {"1": (1, "vector_entry_point"), "16": (NUM_ENVS, "vector_entry_point"), "sync": (NUM_ENVS, "sync")}


def warm_up(task: str) -> None:
    """Make what a process makes once: all frames of one phantom, or the tables of all focal depths."""
    setting = Setting(task=task)
    if not setting.row.phantoms:
        setting.prepare_frames()
        return
    env = setting.plain_env()
    for depth_mm in sorted({pose.focal_depth_mm for pose in setting.guidance.states}):
        env.reset(seed=0, options={"focal_depth_mm": depth_mm})


def steps_per_second(task: str, mode: str, seconds: int, seed: int) -> float:
    """Return the steps of all environments of a task per second."""
    num_envs, vectorization_mode = MODES[mode]
    env = gym.make_vec(BUILT_IN[task].env_id, num_envs, vectorization_mode)
    rate = benchmark_vector_step(env, seconds, seed)
    env.close()
    return rate


def main() -> None:
    """Print the table, a row per task: medians of rounds in alternation."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--tasks", nargs="+", default=list(BUILT_IN), choices=list(BUILT_IN))
    parser.add_argument("--seconds", type=int, default=5, help="of each measurement")
    parser.add_argument("--rounds", type=int, default=3, help="of measurements in alternation")
    args = parser.parse_args()

    print(f"{platform.machine()}, {n_threads()} threads, load {os.getloadavg()[0]:.1f}\n")
    print("| task | 1 environment | 16 environments in step | 16, one after the other | gain |")
    print("|---|---:|---:|---:|---:|")
    for task in args.tasks:
        warm_up(task)
        rates = [
            [steps_per_second(task, mode, args.seconds, seed) for mode in MODES]
            for seed in range(args.rounds)
        ]
        one, many, alone = np.median(rates, axis=0)
        gain = np.median([in_step / after for _, in_step, after in rates])
        print(f"| `{task}` | {one:,.0f} | {many:,.0f} | {alone:,.0f} | {gain:.2f} |", flush=True)


if __name__ == "__main__":
    main()
