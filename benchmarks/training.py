"""Time and memory that training takes, here and in plain scripts: `make bench-train`.

Each algorithm trains in a process of one thread, beside plain scripts (benchmarks/plain) with one thread and
with as many threads as PyTorch takes. The programs take turns, so that other users of the machine slow all of
them alike. Frames are simulated beforehand, and nothing is evaluated.
"""

import argparse
import contextlib
import json
import os
import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from typing import Any

from rich.console import Console
from rich.table import Table

# Compilers, caches and replay buffers warm up for these steps; value-based agents learn from step 500 on.
WARM_UP = 512
# This process stays small, since a child's peak memory begins with its parent's: it imports no torch.
ALGOS = ("vpg", "a2c", "ppo", "dqn", "qrdqn", "trpo", "recurrent_ppo")
ONE_THREAD = {"USBENCH_THREADS": "1", "OMP_NUM_THREADS": "1"}
PROGRAMS = {"here": ("here", ONE_THREAD), "plain": ("plain", ONE_THREAD), "plain, threads": ("plain", {})}
ASKED = 2.0
CAPTION = (
    "Training on {task}: medians of {turns} turns of {steps} steps (or whole rollouts) after {warm_up} more. "
    '"plain" is benchmarks/plain, Stable-Baselines3 itself (vpg: a loop after Spinning Up), with one thread; '
    '"plain, threads" is the same with as many threads as PyTorch takes. The same for all: environment, '
    "frames, stacks, normalisation, network, hyperparameters, seed; from the same weights they learn the "
    "same up to rounding (tests/test_plain_scripts.py). An update is one call of train(). The ratio is the "
    "plain time per step to that here, turn by turn; asked for: at least {asked}."
)


def make(program: str, algo: str, task: str, seed: int = 0) -> Any:
    """The model of `algo`, of this project or of the plain script."""
    import torch
    from stable_baselines3.common.vec_env import DummyVecEnv

    from usbench.agents import zoo
    from usbench.setting import Setting
    from usbench.trials.glibc_memory import keep_freed

    hyperparameters = zoo.hyperparameters(algo, task)
    if program == "here":
        torch.set_num_threads(1)
        keep_freed()
        env = DummyVecEnv([Setting(task=task).make_env])
        return zoo.make(algo, env, seed, hyperparameters, device="cpu")
    if algo == "vpg":
        from plain import environment, spinning_up

        return spinning_up.VPG(environment.make_env(task), seed, **hyperparameters)
    from plain import sb3

    return sb3.make(algo, task, hyperparameters, seed)


class Updates:
    """Counts the calls of a model's `train` and the CPU and wall seconds that they take."""

    def __init__(self, model: Any) -> None:
        """Replaces `model.train` by a call that counts."""
        self.count, self.cpu, self.wall = 0, 0.0, 0.0
        self._train, model.train = model.train, self

    def __call__(self, *args: Any, **kwargs: Any) -> None:
        """One update."""
        cpu, wall = time.process_time(), time.perf_counter()
        self._train(*args, **kwargs)
        self.count += 1
        self.cpu += time.process_time() - cpu
        self.wall += time.perf_counter() - wall


def child(program: str, algo: str, task: str) -> None:
    """Train `algo` in this process: standard input says the steps of each turn; print what each turn took."""
    model = make(program, algo, task)
    model.learn(WARM_UP)
    updates = Updates(model)
    print("warm", flush=True)
    for line in sys.stdin:
        updates.count, updates.cpu, updates.wall = 0, 0.0, 0.0
        cpu, wall, before = time.process_time(), time.perf_counter(), model.num_timesteps
        more = {} if (program, algo) == ("plain", "vpg") else {"reset_num_timesteps": False}
        model.learn(int(line), **more)
        steps, peak = model.num_timesteps - before, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        turn = {
            "cpu": (time.process_time() - cpu) / steps,
            "wall": (time.perf_counter() - wall) / steps,
            "update_cpu": updates.cpu / updates.count,
            "update_wall": updates.wall / updates.count,
            # kB on Linux, bytes on macOS
            "peak_mb": peak / (1e6 if sys.platform == "darwin" else 1e6 / 1024),
        }
        print(json.dumps(turn), flush=True)


@contextlib.contextmanager
def training(program: str, algo: str, task: str, threads: Mapping[str, str]) -> Iterator[Any]:
    """A process that trains on demand, as a function from a number of steps to what these took."""
    inherited = {name: value for name, value in os.environ.items() if name not in ONE_THREAD}
    command = [sys.executable, __file__, "--child", program, "--algos", algo, "--task", task]
    with subprocess.Popen(
        command, text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env={**inherited, **threads}
    ) as process:
        assert process.stdin is not None and process.stdout is not None
        stdin, stdout = process.stdin, process.stdout
        if not stdout.readline():
            raise SystemExit(f"{algo} ({program}) failed, for the reason above.")

        def turn(steps: int) -> dict[str, float]:
            print(steps, file=stdin, flush=True)
            found: dict[str, float] = json.loads(stdout.readline())
            return found

        yield turn


def compare(algo: str, task: str, steps: int, turns: int) -> dict[str, list[dict[str, float]]]:
    """What `turns` turns of every program took, one after the other."""
    found: dict[str, list[dict[str, float]]] = {name: [] for name in PROGRAMS}
    with contextlib.ExitStack() as stack:
        ask = {
            name: stack.enter_context(training(program, algo, task, threads))
            for name, (program, threads) in PROGRAMS.items()
        }
        for _ in range(turns):
            for name in PROGRAMS:
                found[name].append(ask[name](steps))
    return found


def rows(algo: str, found: Mapping[str, list[dict[str, float]]]) -> Iterator[list[str]]:
    """The lines of the table for one algorithm."""
    for name, turns in found.items():
        median = {key: statistics.median(turn[key] for turn in turns) for key in turns[0]}
        ratios = [
            statistics.median(turn[key] / here[key] for turn, here in zip(turns, found["here"], strict=True))
            for key in ("cpu", "wall")
        ]
        yield [
            algo if name == "here" else "",
            name,
            *(f"{1 / median[key]:.0f}" for key in ("cpu", "wall")),
            *(f"{1000 * median[key]:.1f}" for key in ("update_cpu", "update_wall")),
            f"{median['peak_mb']:.0f}",
            *(["", ""] if name == "here" else [f"{ratio:.2f}" for ratio in ratios]),
        ]


def main() -> None:
    """Compare one algorithm after the other and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--algos", nargs="+", default=ALGOS, choices=ALGOS, metavar="NAME")
    parser.add_argument("--task", default="pp", choices=("fp", "pp"))
    parser.add_argument("--steps", type=int, default=256, help="steps of a turn (default 256)")
    parser.add_argument("--turns", type=int, default=3, help="turns of each program (default 3)")
    parser.add_argument("--child", choices=("here", "plain"), help=argparse.SUPPRESS)
    args = parser.parse_args()
    for name in ("steps", "turns"):
        if getattr(args, name) < 1:
            parser.error(f"--{name} must be a whole number of at least 1, not {getattr(args, name)}.")
    if args.child:
        child(args.child, args.algos[0], args.task)
        return
    frames = f"from usbench.setting import Setting; Setting(task={args.task!r}).prepare_frames()"
    subprocess.run([sys.executable, "-c", frames], check=True)
    caption = CAPTION.format(task=args.task, turns=args.turns, steps=args.steps, warm_up=WARM_UP, asked=ASKED)
    table = Table(caption=caption, caption_justify="left")
    heads = (
        *("algorithm", "program", "steps per\nCPU s", "steps per\nsecond", "update\nCPU ms", "update\nms"),
        *("peak\nMB", "ratio,\nCPU", "ratio,\nwall"),
    )
    for number, head in enumerate(heads):
        table.add_column(head, justify="left" if number < 2 else "right", no_wrap=True)
    for algo in args.algos:
        for row in rows(algo, compare(algo, args.task, args.steps, args.turns)):
            table.add_row(*row, end_section=row[1] == [*PROGRAMS][-1])
    Console(width=110).print(table)


if __name__ == "__main__":
    main()
