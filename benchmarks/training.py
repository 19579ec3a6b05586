"""Time and memory that training takes, for every algorithm: `make bench-train`.

Each algorithm trains in a fresh process of one thread, on frames simulated beforehand, without evaluations.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import time
from typing import Any

from rich.console import Console
from rich.table import Table

# Until then compilers, caches and replay buffers warm up; value-based agents learn from step 500 on.
WARM_UP = 512
# This process stays small, since a child's peak memory begins with its parent's: it imports no torch.
ALGOS = ("vpg", "a2c", "ppo", "dqn", "qrdqn", "trpo", "recurrent_ppo")


def measure(algo: str, task: str, steps: int) -> dict[str, float]:
    """Train in this process; return CPU and wall seconds per 1000 steps, and peak memory in MB."""
    import torch
    from stable_baselines3.common.vec_env import DummyVecEnv

    from usbench import suite
    from usbench.agents import zoo

    torch.set_num_threads(1)
    env = DummyVecEnv([lambda: suite.make_env(task)])
    model = zoo.make(algo, env, 0, zoo.hyperparameters(algo, task), device="cpu")
    model.learn(WARM_UP)
    cpu, wall, before = time.process_time(), time.perf_counter(), model.num_timesteps
    model.learn(steps, reset_num_timesteps=False)
    done = (model.num_timesteps - before) / 1000
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss  # kB on Linux, bytes on macOS
    return {
        "cpu_s": (time.process_time() - cpu) / done,
        "wall_s": (time.perf_counter() - wall) / done,
        "peak_mb": peak / (1e6 if sys.platform == "darwin" else 1e6 / 1024),
    }


def in_fresh_process(*argv: str) -> Any:
    """Run this file with `argv` and return what it prints, from JSON."""
    done = subprocess.run(
        [sys.executable, __file__, *argv],
        check=True,
        stdout=subprocess.PIPE,
        env={**os.environ, "USBENCH_THREADS": "1", "OMP_NUM_THREADS": "1"},
    )
    return json.loads(done.stdout)


def main() -> None:
    """Measure one algorithm after the other and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--algos", nargs="+", default=ALGOS, choices=ALGOS, metavar="NAME")
    parser.add_argument("--task", default="pp", choices=("fp", "pp"))
    parser.add_argument("--steps", type=int, default=1024, help="timed steps (default 1024)")
    parser.add_argument("--child", action="store_true", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.steps < 1:
        parser.error(f"--steps must be a whole number of at least 1, not {args.steps}.")
    if args.child:
        print(json.dumps(measure(args.algos[0], args.task, args.steps)))
        return
    frames = f"from usbench import runner; runner.prepare_frames({args.task!r})"
    subprocess.run([sys.executable, "-c", frames], check=True)
    table = Table(
        caption=f"Training on {args.task}: {args.steps} steps (or whole rollouts) after the first {WARM_UP}."
    )
    for name in ("algorithm", "CPU s per\n1000 steps", "steps per\nsecond", "peak memory\n(MB)"):
        table.add_column(name, justify="left" if name == "algorithm" else "right", no_wrap=True)
    for algo in args.algos:
        found = in_fresh_process("--child", "--algos", algo, "--task", args.task, "--steps", str(args.steps))
        speed = 1000 / found["wall_s"]
        table.add_row(algo, f"{found['cpu_s']:.1f}", f"{speed:.0f}", f"{found['peak_mb']:.0f}")
    Console(width=100).print(table)


if __name__ == "__main__":
    main()
