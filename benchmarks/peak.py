"""Share of a core's measured peak that training sustains, and what the rest of the time goes to.

The peak is that of a large matrix product with one thread, in multiply-adds per CPU second. On some
processors PyTorch's convolution is faster, so that a second share is that of a large convolution.
Multiply-adds of training are counted by PyTorch as it runs (`torch.utils.flop_counter`), on one rollout or as
many steps, and set in proportion to the CPU time of as many steps that were not counted. With `--operators`,
PyTorch's profiler says which operators take the time.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable
from typing import Any

import torch
from rich.console import Console
from rich.table import Table
from torch.profiler import ProfilerActivity, profile
from torch.utils.flop_counter import FlopCounterMode
from training import ALGOS, WARM_UP, make

PEAK_SIZE = 2048  # rows and columns
CHANNELS, PLACES, IMAGES = 256, 32, 16  # of the convolution, whose kernel is 3 x 3
TURNS = 5
SHOWN = 12  # operators


def cpu_seconds(work: Callable[[], object]) -> float:
    """Return the CPU time of a call."""
    start = time.process_time()
    work()
    return time.process_time() - start


def peak() -> float:
    """Return the multiply-adds per CPU second of a large matrix product, the best of a few."""
    matrix = torch.randn(PEAK_SIZE, PEAK_SIZE)
    return PEAK_SIZE**3 / min(cpu_seconds(lambda: matrix @ matrix) for _ in range(2 * TURNS))


def convolution() -> float:
    """Return the multiply-adds per CPU second of a large convolution, the best of a few."""
    images = torch.randn(IMAGES, CHANNELS, PLACES, PLACES)
    layer = torch.nn.Conv2d(CHANNELS, CHANNELS, 3, padding=1)
    multiply_adds = images.numel() * CHANNELS * 3 * 3
    with torch.no_grad():
        return multiply_adds / min(cpu_seconds(lambda: layer(images)) for _ in range(2 * TURNS))


def steps_of(model: Any, steps: int) -> int:
    """Train for `steps` more, or the whole rollouts that hold them; return how many these were."""
    before = model.num_timesteps
    model.learn(steps, reset_num_timesteps=False)
    return int(model.num_timesteps - before)


def shares(algo: str, task: str, steps: int) -> tuple[float, float, list[float]]:
    """Return CPU ms and million multiply-adds per step of `algo`, and the shares of both peaks."""
    model = make("here", algo, task)
    model.learn(WARM_UP)
    counter = FlopCounterMode(display=False)
    with counter:
        counted = steps_of(model, steps)
    multiply_adds = counter.get_total_flops() / 2 / counted
    # Peaks are measured before every turn, as other users of the machine slow both.
    turns = [
        (peak(), convolution(), cpu_seconds(lambda: steps_of(model, steps)) / counted) for _ in range(TURNS)
    ]
    seconds = [turn[-1] for turn in turns]
    share = [statistics.median(multiply_adds / (turn[-1] * turn[kind]) for turn in turns) for kind in (0, 1)]
    return 1e3 * statistics.median(seconds), 1e-6 * multiply_adds, share


def operators(algo: str, task: str, steps: int) -> Table:
    """Return what takes the time of training, operator by operator."""
    model = make("here", algo, task)
    model.learn(WARM_UP)
    with profile(activities=[ProfilerActivity.CPU]) as profiled:
        start = time.perf_counter()
        steps_of(model, steps)
        seconds = time.perf_counter() - start
    found = sorted(profiled.key_averages(), key=lambda event: -event.self_cpu_time_total)
    table = Table("operator", "calls", "share of the time", title=f"{algo} on {task}, {steps} steps")
    for event in found[:SHOWN]:
        table.add_row(event.key, str(event.count), f"{event.self_cpu_time_total / 1e6 / seconds:.1%}")
    outside = 1 - sum(event.self_cpu_time_total for event in found) / 1e6 / seconds
    table.add_row("outside of PyTorch", "", f"{outside:.1%}")
    return table


def main() -> None:
    """Print a table of all algorithms, or one of operators for each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--algos", nargs="+", default=ALGOS, choices=ALGOS, metavar="NAME")
    parser.add_argument("--task", default="pp", choices=("fp", "pp"))
    parser.add_argument("--steps", type=int, default=512, help="steps of a turn (default 512)")
    parser.add_argument("--operators", action="store_true", help="what takes the time, by PyTorch's profiler")
    args = parser.parse_args()
    torch.set_num_threads(1)  # before the peaks that the title tells
    console = Console(width=110)
    if args.operators:
        for algo in args.algos:
            console.print(operators(algo, args.task, args.steps))
        return
    title = (
        f"Training on {args.task}, one thread; billion multiply-adds per second at most: "
        f"{peak() / 1e9:.0f} in a matrix product, {convolution() / 1e9:.0f} in a convolution"
    )
    ofs = ("share of a matrix product", "share of a convolution")
    table = Table("algorithm", "CPU ms per step", "million multiply-adds per step", *ofs, title=title)
    for algo in args.algos:
        time_ms, millions, share = shares(algo, args.task, args.steps)
        table.add_row(algo, f"{time_ms:.1f}", f"{millions:.0f}", *(f"{one:.0%}" for one in share))
    console.print(table)


if __name__ == "__main__":
    main()
