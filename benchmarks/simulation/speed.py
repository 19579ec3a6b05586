"""The time of frames, of episodes and of whole tasks."""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from simulation.measuring import Row, median_seconds, no_tables, peak_memory_mb, seconds
from usbench.envs.bmode import DEFAULT_IMAGING
from usbench.envs.field.response_table import forget_tables, keep_tables
from usbench.envs.frames import FrameStore
from usbench.envs.phantom import Phantom
from usbench.envs.pose import Pose
from usbench.envs.probe import DEFAULT_ARRAY
from usbench.envs.rf import simulate_iq
from usbench.envs.scanner import scan, scan_batch, view
from usbench.envs.tasks.focal_point import FOCAL_POINT
from usbench.envs.tasks.probe_plane import PROBE_PLANE
from usbench.envs.tasks.random_phantoms import FocalPointRandomEnv, ProbePlaneRandomEnv

ROUNDS = 4
COMMAND = Path(__file__).parents[1] / "simulator.py"


def speed(n: int) -> Iterator[Row]:
    """Time frames of the default phantom, tables warm, and the first frame at a new focal depth.

    Focal depths take turns, so that other users of the machine slow all depths alike.
    """
    phantom = Phantom()
    phantom.in_view(Pose(), *view(DEFAULT_ARRAY, DEFAULT_IMAGING))
    frames = {depth: partial(scan, phantom, Pose(0, depth)) for depth in range(5, 95, 5)}
    keep_tables(len(frames))
    frames[45]()
    with no_tables():
        first = {depth: seconds(frame) for depth, frame in frames.items()}
    timed: dict[int, list[float]] = {depth: [] for depth in frames}
    for _ in range(ROUNDS):
        for depth, frame in frames.items():
            timed[depth] += [seconds(frame) for _ in range(n)]
    rates = {depth: 1 / statistics.median(times) for depth, times in timed.items()}
    slowest = min(rates, key=lambda depth: rates[depth])
    yield "frames per second, pose to pixels, focus 50 mm", f"{rates[50]:.0f}", "at least 150"
    yield f"frames per second, slowest focal depth ({slowest} mm)", f"{rates[slowest]:.0f}", "at least 75"
    scenes = [(Phantom(seed), Pose(x, 50, 15 * seed)) for seed in range(8) for x in range(-15, 20, 5)]
    scan_batch(scenes)  # draws the phantoms
    per_frame = median_seconds(lambda: scan_batch(scenes), 5) / len(scenes)
    yield f"frames per second, {len(scenes)} of 8 phantoms in one batch, 50 mm", f"{1 / per_frame:.0f}", ""
    new = f"first frame at a new focal depth, worst of {len(first)}"
    yield new, f"{max(first.values()):.2f} s", "at most 2.5 s"


def environments(n: int) -> Iterator[Row]:
    """Time `n` episodes of random actions, a new phantom in each, frames simulated as the probe moves."""
    generator = np.random.default_rng(0)
    for env in (ProbePlaneRandomEnv(), FocalPointRandomEnv()):
        for depth in sorted({pose.focal_depth_mm for pose in env.task.states}):
            scan(Phantom(), Pose(0, depth))  # makes the table of this depth
        env.reset(seed=0)
        start = time.perf_counter()
        for _ in range(n):
            env.reset()
            for _ in range(env.task.n_steps):
                env.step(int(generator.integers(len(env.task.actions))))
        rate = n * env.task.n_steps / (time.perf_counter() - start)
        what = f"steps per second, {env.task.name}, a new phantom in each of {n} episodes"
        yield what, f"{rate:.0f}", "at least 60"


def scaling() -> Iterator[Row]:
    """Time 1 and 10 times the scatterers of the default view."""
    positions, amplitudes = Phantom().in_view(Pose(), *view(DEFAULT_ARRAY, DEFAULT_IMAGING))
    rng = np.random.default_rng(0)
    many = np.tile(positions, (10, 1)) + rng.uniform(-2e-4, 2e-4, (10 * len(positions), 3))
    many[:, 2] = np.abs(many[:, 2]) + 1e-6
    one = median_seconds(lambda: simulate_iq(positions, amplitudes, DEFAULT_ARRAY, 0.05), 15)
    ten = median_seconds(lambda: simulate_iq(many, np.tile(amplitudes, 10), DEFAULT_ARRAY, 0.05), 5)
    yield "time of 10 times the scatterers over that of one", f"{ten / one:.1f}", "at most 11"


def all_frames() -> None:
    """Simulate all frames of both tasks and print seconds for PP, for both, and the peak memory in MB."""
    forget_tables()
    store = FrameStore(Phantom(), DEFAULT_ARRAY, DEFAULT_IMAGING)
    start = time.perf_counter()
    store.prepare(PROBE_PLANE.states)
    probe_plane = time.perf_counter() - start
    store.prepare(FOCAL_POINT.states)
    print(probe_plane, time.perf_counter() - start, peak_memory_mb())


def from_nothing() -> Iterator[Row]:
    """Run `all_frames` in a separate process with an empty cache."""
    with tempfile.TemporaryDirectory() as folder:
        output = subprocess.run(
            [sys.executable, str(COMMAND), "--all-frames"],
            env={**os.environ, "USBENCH_CACHE": folder},
            check=True,
            capture_output=True,
            text=True,
        ).stdout
    probe_plane, both, peak = map(float, output.split())
    yield "all 216 PP frames from nothing", f"{probe_plane:.1f} s", "at most 90 s"
    yield "all 162 FP and 216 PP frames from nothing", f"{both:.1f} s", "at most 40 s"
    yield "peak memory of the process that made all these frames", f"{peak:.0f} MB", "at most 700 MB"
