"""What a Dask cluster does to a large comparison: `python benchmarks/scaling.py`, some minutes.

Measured: seconds and size of the finished trials in a folder, and what the cluster costs per trial, on
two worker processes of this machine, with trials that do nothing and with trials that only leave files of
that size. From these numbers follows how long a grid takes on a given number of workers.
"""

import argparse
import dataclasses
import functools
import os
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import wait
from pathlib import Path
from typing import Any

from distributed import LocalCluster
from rich.console import Console
from rich.table import Table

from usbench import records
from usbench.compare import dask_cluster
from usbench.trials import configuration

WARM_UP = 20


def finished(runs: Path) -> tuple[list[float], list[int]]:
    """Return seconds and bytes of every finished trial of an algorithm that learns."""
    seconds, sizes = [], []
    for folder in records.trial_folders(runs):
        trial = records.Trial.read(folder)
        if trial.status == "finished" and trial.config.steps:
            seconds.append(trial.timings["total_s"])
            files = [path for pattern in dask_cluster.FILES for path in folder.glob(pattern)]
            sizes.append(sum(path.stat().st_size for path in files))
    if not seconds:
        sys.exit(f"there is no finished trial in {str(runs)!r}: run usbench compare first.")
    return seconds, sizes


def leave(size: int, config: records.TrialConfig, out: Path, progress: Any) -> None:
    """Stand in for a trial: do nothing but leave a file of `size` bytes, and no file for 0."""
    if size:
        folder = out / config.folder_name
        folder.mkdir()
        (folder / records.MODEL).write_bytes(os.urandom(size))
        (folder / records.TRIAL).write_text("{}")


def cost(workers: dask_cluster.Cluster, n_trials: int, trial: Callable[..., None]) -> tuple[float, float]:
    """Return seconds per trial, and the CPU seconds per trial of scheduler and client."""
    first = configuration.resolve("stay", "pp")
    configs = [dataclasses.replace(first, seed=seed) for seed in range(n_trials)]
    with tempfile.TemporaryDirectory() as out:
        wait([workers.submit(trial, config, Path(out, "warm")) for config in configs[:WARM_UP]])
        start, start_cpu = time.perf_counter(), time.process_time()
        done = [workers.submit(trial, config, Path(out)) for config in configs]
        for future in done:
            future.result()
        return (time.perf_counter() - start) / n_trials, (time.process_time() - start_cpu) / n_trials


def main() -> None:
    """Measure, and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=Path, default=Path("runs"), help="folder of finished trials")
    parser.add_argument("--trials", type=int, default=300, help="trials to measure the overhead with")
    parser.add_argument("--grid", type=int, default=10_000, help="trials of the grid")
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 10, 100, 1000])
    args = parser.parse_args()
    seconds, sizes = finished(args.runs)
    trial_s, size = statistics.mean(seconds), int(statistics.mean(sizes))
    with (
        LocalCluster(n_workers=2, threads_per_worker=1, host="127.0.0.1", dashboard_address=None) as local,
        dask_cluster.Cluster(local.scheduler_address) as workers,
    ):
        bare = cost(workers, args.trials, functools.partial(leave, 0))
        full = cost(workers, args.trials, functools.partial(leave, size))
    console = Console(width=110)
    console.print(
        f"{len(seconds)} finished trials: {trial_s:.0f} s on average "
        f"({min(seconds):.0f} to {max(seconds):.0f}), {size / 1e6:.2f} MB of files\n"
        f"overhead per trial ({args.trials} trials, 2 workers): {bare[0] * 1e3:.1f} ms, of which scheduler "
        f"and client compute {bare[1] * 1e3:.1f} ms\n"
        f"with files: {full[0] * 1e3:.1f} ms, of which scheduler and client compute {full[1] * 1e3:.1f} ms\n"
    )
    table = Table(title=f"A grid of {args.grid} trials of {trial_s:.0f} s")
    for title in ("workers", "trials, at most", "overhead", "total", "speed-up", "of the workers"):
        table.add_column(title, justify="right")
    for n_workers in args.workers:
        # Upper bound for a queue (Graham 1966): the longest trial may start last.
        queue = args.grid * trial_s / n_workers + max(seconds) * (1 - 1 / n_workers)
        # All trials go through one scheduler. CPU time, since other users of the machine add to wall time.
        overhead = args.grid * full[1]
        total = max(queue, overhead)
        speed_up = args.grid * trial_s / total
        hours = [f"{value / 3600:.2f} h" for value in (queue, overhead, total)]
        table.add_row(str(n_workers), *hours, f"{speed_up:.0f}", f"{speed_up / n_workers:.0%}")
    console.print(table)


if __name__ == "__main__":
    main()
