"""Sums over few and many points: what a table of responses takes, and from when on it pays."""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from simulation.measuring import Row, cpu_seconds, median_seconds, no_tables, peak_memory_mb, seconds
from usbench.envs import rf as engine
from usbench.envs.probe import DEFAULT_ARRAY, LinearArray
from usbench.envs.rf import simulate_iq

EDGE_ARRAY = LinearArray(
    center_frequency=7e6,
    n_elements=128,
    element_width=0.27e-3,
    kerf=0.03e-3,
    n_lines=128,
    line_spacing=0.3e-3,
)
COMMAND = Path(__file__).parents[1] / "simulator.py"


def few_points() -> Iterator[Row]:
    """Time 12 points with an array of which every second line lies beyond the last full aperture."""
    points = np.stack([np.linspace(-18e-3, 18e-3, 12), np.zeros(12), np.full(12, 30e-3)], axis=1)
    before = time.process_time()
    simulate_iq(points, np.ones(12), EDGE_ARRAY, 30e-3)
    first = time.process_time() - before
    before = time.process_time()
    again = median_seconds(lambda: simulate_iq(points, np.ones(12), EDGE_ARRAY, 30e-3), 15)
    cpu = (time.process_time() - before) / 15
    yield "12 points, 128 lines at 7 MHz: first call, of all cores", f"{first:.2f} s", "at most 5 s"
    yield "the same, second call", f"{1e3 * again:.0f} ms", "at most 20 ms"
    yield "the same, CPU time of all cores", f"{1e3 * cpu:.0f} ms", ""


def break_even() -> Iterator[Row]:
    """Compare what a pair of line and scatterer takes summed directly with what a table takes to make."""
    points = np.random.default_rng(0).uniform([-20e-3, -5e-3, 1e-3], [20e-3, 5e-3, 90e-3], (32, 3))
    lines = DEFAULT_ARRAY.line_positions
    pairs = len(points) * len(lines)

    frame = (points, np.ones(len(points)), DEFAULT_ARRAY, 0.05, lines)
    assert pairs <= engine.FEW_PAIRS
    simulate_iq(*frame)
    direct = statistics.median(cpu_seconds(lambda: simulate_iq(*frame)) for _ in range(9))
    engine.FEW_PAIRS, few = 0, engine.FEW_PAIRS
    with no_tables():
        made = cpu_seconds(lambda: simulate_iq(*frame))
    table = statistics.median(cpu_seconds(lambda: simulate_iq(*frame)) for _ in range(9))
    engine.FEW_PAIRS = few
    yield f"CPU time of a pair summed directly ({pairs} pairs)", f"{1e6 * direct / pairs:.1f} us", ""
    yield "CPU time of the same with a table that is there", f"{1e6 * table / pairs:.1f} us", ""
    yield "pairs summed directly in the CPU time of making a table", f"{made / direct * pairs:.0f}", ""
    yield f"calls with {pairs} pairs after which a table pays", f"{made / max(direct - table, 1e-9):.0f}", ""


def dense_to_the_edge() -> Iterator[Row]:
    """Time many scatterers with the array of `few_points`, of which half the lines have no full aperture."""
    n = 10_000
    rng = np.random.default_rng(0)
    points = rng.uniform([-19e-3, -2.5e-3, 1e-3], [19e-3, 2.5e-3, 45e-3], (n, 3))
    once = seconds(lambda: simulate_iq(points, np.ones(n), EDGE_ARRAY, 30e-3))
    yield f"{n} points, 128 lines at 7 MHz, half of them beyond the last full aperture", f"{once:.1f} s", ""
    yield "peak memory of the same process after these points", f"{peak_memory_mb():.0f} MB", ""


def throughput() -> Iterator[Row]:
    """Time scatterers spread evenly over the view, with one thread and two, and the memory that they take."""
    for n in (2_700, 100_000, 1_000_000):
        rng = np.random.default_rng(0)
        points = rng.uniform([-20e-3, -5e-3, 1e-3], [20e-3, 5e-3, 90e-3], (n, 3))
        amplitudes, pairs = rng.normal(size=n), n * DEFAULT_ARRAY.n_lines
        for threads in (1, 2):
            os.environ["USBENCH_THREADS"] = str(threads)
            work = partial(simulate_iq, points, amplitudes, DEFAULT_ARRAY, 0.05)
            rate = pairs / median_seconds(work, 15 if n < 10_000 else 3)
            what = f"scatterers x lines per second, {n} scatterers, {threads} thread{'s' * (threads > 1)}"
            yield what, f"{rate / 1e6:.1f} million", ""
        del os.environ["USBENCH_THREADS"]
    what = f"peak memory of the process of these sums, after {n} scatterers"
    yield what, f"{peak_memory_mb():.0f} MB", "at most 2000 MB"


def apart() -> Iterator[Row]:
    """Run `few_points` and `throughput` in a process of their own, for its memory and first call."""
    command = [sys.executable, str(COMMAND), "--throughput"]
    output = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    for line in output.splitlines():
        what, measured, asked = line.split("\t")
        yield what, measured, asked


PARTS = (few_points, break_even, throughput, dense_to_the_edge)
