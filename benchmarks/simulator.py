"""Accuracy and speed of the simulator, as a table: `make bench-sim`.

Accuracy means: compared with RF of an independent code (esdiva 0.3.0, the Field II method), of which eight
lines are in tests/reference; where all 64 lines lie beside the repository, all are compared. The ratio of the
speeds needs esdiva itself, which the extra `bench` installs. The engine before the present one is taken from
the history of the repository, zea from an installation of yours (`pip install zea==0.1.8`).
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from itertools import chain
from pathlib import Path

import numpy as np
import numpy.typing as npt
from rich.console import Console
from rich.table import Table

from usbench.envs import rf as engine
from usbench.envs.bmode import DEFAULT_IMAGING, bmode, envelope, log_compress
from usbench.envs.field.response_table import forget_tables, keep_tables
from usbench.envs.frames import FrameStore
from usbench.envs.phantom import Phantom
from usbench.envs.pose import Pose
from usbench.envs.probe import DEFAULT_ARRAY, LinearArray
from usbench.envs.rf import simulate_iq, simulate_rf
from usbench.envs.scanner import scan, scan_batch, view
from usbench.envs.tasks.focal_point import FOCAL_POINT
from usbench.envs.tasks.probe_plane import PROBE_PLANE
from usbench.envs.tasks.random_phantoms import FocalPointRandomEnv, ProbePlaneRandomEnv

ROOT = Path(__file__).parents[1]
EXTRACT = ROOT / "tests" / "reference" / "rf_reference.npz"
ALL_LINES = ROOT.parent / "shared" / "reference" / "rf_reference.npz"
REFERENCE = ALL_LINES if ALL_LINES.exists() else EXTRACT
ROUNDS = 4
# The last commit of the engine before.
OLD_ENGINE = "21a33ca"
ZEA_SHARE = 100  # of the scatterers, one in so many
EDGE_ARRAY = LinearArray(
    center_frequency=7e6,
    n_elements=128,
    element_width=0.27e-3,
    kerf=0.03e-3,
    n_lines=128,
    line_spacing=0.3e-3,
)
Row = tuple[str, str, str]
Floats = npt.NDArray[np.float64]


def correlation(a: Floats, b: Floats) -> float:
    """Return the normalised correlation of two signals of the same shape."""
    return float((a * b).sum() / np.sqrt(np.square(a).sum() * np.square(b).sum()))


def accuracy() -> Iterator[Row]:
    """Compare RF, single points and images with the reference."""
    data = dict(np.load(REFERENCE))
    for i, (focus, asked, asked_line) in enumerate(((50, 0.998, 0.98), (20, 0.996, 0.97))):
        rf, time_s = simulate_rf(
            data["points"], data["amplitudes"], DEFAULT_ARRAY, focus * 1e-3, data["x_lines"]
        )
        ours = rf[:3200].astype(np.float64)
        theirs = data["rf_fst"][i, :, : len(ours)].T.astype(np.float64)
        lines = [correlation(a, b) for a, b in zip(ours.T, theirs.T, strict=True)]
        energy = np.square(theirs).sum(axis=0)
        loud = energy >= 0.01 * energy.mean()
        yield (
            f"RF correlation, focus {focus} mm, {len(lines)} lines",
            f"{correlation(ours, theirs):.5f}",
            f"{asked}",
        )
        worst = min(np.array(lines)[loud])
        yield (
            f"RF correlation, focus {focus} mm, worst of {loud.sum()} lines",
            f"{worst:.4f}",
            f"{asked_line}",
        )

        envelopes = [log_compress(envelope(signals), 60.0) for signals in (ours, theirs)]
        yield image_row(f"60 dB image, focus {focus} mm: rms above -40 dB", *frames(data, ours, theirs))
        yield image_row(f"the same, envelope at the RF's samples, focus {focus} mm", *envelopes)
        yield from points(data, i, focus, float(np.sqrt(np.square(theirs).sum() / np.square(ours).sum())))


def frames(data: dict[str, Floats], *signals: Floats) -> list[Floats]:
    """Return the frames in dB above black that the product's chain makes of RF at the reference's lines."""
    return [
        bmode(rf, DEFAULT_ARRAY.rf_sampling_frequency, data["x_lines"], -DEFAULT_ARRAY.pulse_delay)
        * (60 / 255)
        for rf in signals
    ]


def image_row(what: str, ours: Floats, theirs: Floats) -> Row:
    """Compare images in dB above black where the reference is above -40 dB of 60."""
    rms = float(np.sqrt(np.square(ours - theirs)[theirs > 20.0].mean()))
    return what, f"{rms:.2f} dB", "at most 1 dB"


def points(data: dict[str, Floats], i: int, focus: int, gain: float) -> Iterator[Row]:
    """Compare single points within 30 dB of the strongest at their depth; all others are only counted."""
    correlations, errors_db, n = [], [], 0
    peaks = np.abs(data["pt_rf"][i]).max(axis=-1)
    for iz, ix, iy in np.ndindex(*peaks.shape):
        n += 1
        if peaks[iz, ix, iy] < peaks[iz].max() * 10 ** (-30 / 20):
            continue
        position = [[data["pt_x"][ix], data["pt_y"][iy], data["pt_z"][iz]]]
        rf, time_s = simulate_rf(position, [gain], DEFAULT_ARRAY, focus * 1e-3, [0.0])
        first = round(float(data["pt_t0"][i, iz, ix, iy]) * DEFAULT_ARRAY.rf_sampling_frequency)
        ours = np.zeros(1600)
        part = rf[first : first + 1600, 0]
        ours[: len(part)] = part
        theirs = data["pt_rf"][i, iz, ix, iy].astype(np.float64)
        correlations.append(correlation(ours, theirs))
        errors_db.append(abs(20 * np.log10(np.abs(ours).max() / np.abs(theirs).max())))
    what = f"{len(correlations)} of {n} points within 30 dB, focus {focus} mm"
    yield f"{what}: least correlation", f"{min(correlations):.4f}", "0.97"
    yield f"{what}: largest gain error", f"{max(errors_db):.2f} dB", "at most 1 dB"


def seconds(work: Callable[[], object]) -> float:
    """Return the wall time of a call."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def median_seconds(work: Callable[[], object], n: int) -> float:
    """Return the median wall time of `n` calls."""
    return statistics.median(seconds(work) for _ in range(n))


def speed(n: int) -> Iterator[Row]:
    """Time frames of the default phantom, tables warm, and the first frame at a new focal depth.

    Focal depths take turns, so that other users of the machine slow all depths alike.
    """
    phantom = Phantom()
    phantom.in_view(Pose(), *view(DEFAULT_ARRAY, DEFAULT_IMAGING))
    frames = {depth: partial(scan, phantom, Pose(0, depth)) for depth in range(5, 95, 5)}
    keep_tables(len(frames))
    frames[45]()
    first = {}
    kept = os.environ.get("USBENCH_CACHE")
    with tempfile.TemporaryDirectory() as folder:
        os.environ["USBENCH_CACHE"] = folder  # no table is on disk
        forget_tables()
        for depth, frame in frames.items():
            first[depth] = seconds(frame)
        del os.environ["USBENCH_CACHE"]
    if kept is not None:
        os.environ["USBENCH_CACHE"] = kept
    timed: dict[int, list[float]] = {depth: [] for depth in frames}
    for _ in range(ROUNDS):
        for depth, frame in frames.items():
            timed[depth] += [seconds(frame) for _ in range(n)]
    rates = {depth: 1 / statistics.median(times) for depth, times in timed.items()}
    slowest = min(rates, key=lambda depth: rates[depth])
    yield "frames per second, pose to pixels, focus 50 mm", f"{rates[50]:.0f}", "150"
    yield f"frames per second, slowest focal depth ({slowest} mm)", f"{rates[slowest]:.0f}", "75"
    scenes = [(Phantom(seed), Pose(x, 50, 15 * seed)) for seed in range(8) for x in range(-15, 20, 5)]
    scan_batch(scenes)  # draws the phantoms
    per_frame = median_seconds(lambda: scan_batch(scenes), 5) / len(scenes)
    yield f"frames per second, {len(scenes)} of 8 phantoms in one batch, 50 mm", f"{1 / per_frame:.0f}", ""
    yield "first frame at a new focal depth, worst of 17", f"{max(first.values()):.2f} s", "at most 2.5 s"


def engines() -> Iterator[Row]:
    """Time the engine before and the present one in turns, each in its own process, tables made anew."""
    with tempfile.TemporaryDirectory() as folder:
        old = Path(folder) / "old"
        if not unpacked(OLD_ENGINE, Path(folder) / "source", old):
            yield f"the engine of commit {OLD_ENGINE}: not in this copy's history", "", ""
            return
        times: dict[tuple[str, int], list[tuple[float, float]]] = {}
        for turn in range(ROUNDS):
            # Tables are new in every round, as the processes are.
            cache = {"USBENCH_CACHE": str(Path(folder) / f"cache{turn}")}
            workers = {
                name: subprocess.Popen(
                    [sys.executable, str(Path(__file__).with_name("engine.py"))],
                    env={**os.environ, **cache, **path},
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    text=True,
                )
                for name, path in (("old", {"PYTHONPATH": str(old)}), ("new", {}))
            }
            for depth in (50, 20, 5):
                for name, worker in workers.items():
                    assert worker.stdin is not None and worker.stdout is not None
                    print(depth, file=worker.stdin, flush=True)
                    first, other = map(float, worker.stdout.readline().split())
                    times.setdefault((name, depth), []).append((first, other))
            for worker in workers.values():
                worker.communicate()
    for depth in (50, 20, 5):
        (old_first, old_rest), (first, rest) = (
            np.median(times[name, depth], axis=0) for name in ("old", "new")
        )
        what = f"focus {depth} mm, engine of {OLD_ENGINE} over the present one"
        yield f"{what}: time of a frame", f"{old_rest / rest:.2f}", "2" if depth == 50 else "4"
        yield f"{what}: time of a first frame", f"{old_first / first:.2f}", "2"


def unpacked(commit: str, source: Path, target: Path) -> bool:
    """Install the package of an earlier commit into the folder `target`; return whether git knows it."""
    archive = subprocess.run(["git", "archive", commit], cwd=ROOT, capture_output=True)
    if archive.returncode:
        return False
    source.mkdir()
    subprocess.run(["tar", "x", "-C", str(source)], input=archive.stdout, check=True)
    for part in ("envs", "agents"):
        shutil.copytree(source / part, target / "usbench" / part)
    shutil.copytree(source / "usbench", target / "usbench", dirs_exist_ok=True)
    return True


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
        yield f"steps per second, {env.task.name}, a new phantom in each of {n} episodes", f"{rate:.0f}", "60"


def scaling() -> Iterator[Row]:
    """Time 1 and 10 times the scatterers of the default view."""
    positions, amplitudes = Phantom().in_view(Pose(), *view(DEFAULT_ARRAY, DEFAULT_IMAGING))
    rng = np.random.default_rng(0)
    many = np.tile(positions, (10, 1)) + rng.uniform(-2e-4, 2e-4, (10 * len(positions), 3))
    many[:, 2] = np.abs(many[:, 2]) + 1e-6
    one = median_seconds(lambda: simulate_iq(positions, amplitudes, DEFAULT_ARRAY, 0.05), 15)
    ten = median_seconds(lambda: simulate_iq(many, np.tile(amplitudes, 10), DEFAULT_ARRAY, 0.05), 5)
    yield "time of 10 times the scatterers over that of one", f"{ten / one:.1f}", "at most 11"


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

    def cpu(work: Callable[[], object]) -> float:
        start = time.process_time()
        work()
        return time.process_time() - start

    frame = (points, np.ones(len(points)), DEFAULT_ARRAY, 0.05, lines)
    assert pairs <= engine.FEW_PAIRS
    simulate_iq(*frame)
    direct = statistics.median(cpu(lambda: simulate_iq(*frame)) for _ in range(9))
    engine.FEW_PAIRS, few = 0, engine.FEW_PAIRS
    with tempfile.TemporaryDirectory() as folder:
        kept = os.environ.get("USBENCH_CACHE")
        os.environ["USBENCH_CACHE"] = folder
        forget_tables()
        made = cpu(lambda: simulate_iq(*frame))
        os.environ.pop("USBENCH_CACHE")
        os.environ.update({} if kept is None else {"USBENCH_CACHE": kept})
    table = statistics.median(cpu(lambda: simulate_iq(*frame)) for _ in range(9))
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
    yield "peak memory of that process", f"{peak_memory_mb():.0f} MB", ""


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
    yield "peak memory of that process", f"{peak_memory_mb():.0f} MB", "at most 2000 MB"


def apart() -> Iterator[Row]:
    """Run `few_points` and `throughput` in a process of their own, for its memory and first call."""
    command = [sys.executable, __file__, "--throughput"]
    output = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    for line in output.splitlines():
        what, measured, asked = line.split("\t")
        yield what, measured, asked


def ratio() -> Iterator[Row]:
    """Time a frame of RF, and the same frame by esdiva immediately afterwards."""
    from peer import Peer

    data = np.load(REFERENCE)
    positions, amplitudes = data["points"].astype(np.float64), data["amplitudes"].astype(np.float64)
    lines = data["x_lines"][0] + DEFAULT_ARRAY.line_spacing * np.arange(DEFAULT_ARRAY.n_lines)
    frame = (positions, amplitudes, DEFAULT_ARRAY, 0.05, lines)
    ours = median_seconds(lambda: simulate_rf(*frame), 15)
    baseband = median_seconds(lambda: simulate_iq(*frame), 15)
    signals, theirs = Peer(DEFAULT_ARRAY).frame(positions, amplitudes, 0.05, lines)
    rf, time_s = simulate_rf(*frame)
    step = 1 / DEFAULT_ARRAY.sampling_frequency
    expected = np.stack(
        [np.interp(time_s, first + np.arange(len(line)) * step, line, 0.0, 0.0) for line, first in signals], 1
    )
    what = f"{len(positions)} scatterers, {len(lines)} lines, focus 50 mm"
    yield f"{what}: esdiva, fst", f"{theirs:.1f} s", ""
    yield "the same, RF: esdiva's time over ours", f"{theirs / ours:.0f}", "1000"
    yield "the same, I/Q, all that an image needs: esdiva's time over ours", f"{theirs / baseband:.0f}", ""
    yield "correlation of both signals", f"{correlation(rf.astype(np.float64), expected):.5f}", "0.998"


def ratio_to_zea() -> Iterator[Row]:
    """Time a frame of RF, and a share of the same frame by zea immediately afterwards."""
    from zea_frame import seconds as zea_seconds

    positions, amplitudes = Phantom().in_view(Pose(), *view(DEFAULT_ARRAY, DEFAULT_IMAGING))
    ours = median_seconds(lambda: simulate_rf(positions, amplitudes, DEFAULT_ARRAY, 0.05), 15)
    some = slice(None, None, ZEA_SHARE)
    theirs = zea_seconds(positions[some], amplitudes[some], DEFAULT_ARRAY, 0.05)
    whole = theirs * len(positions) / len(positions[some])
    what = f"{len(positions[some])} of {len(positions)} scatterers, 64 transmits, 192 elements"
    yield f"{what}: zea 0.1.8, PyTorch, CPU", f"{theirs:.1f} s", ""
    yield "zea's time for all of them, in proportion, over ours for 64 lines of RF", f"{whole / ours:.0f}", ""


def peak_memory_mb() -> float:
    """Return the peak memory of this process; where Linux tells it, without what its parent had."""
    status = Path("/proc/self/status")
    if status.exists():
        (line,) = (line for line in status.read_text().splitlines() if line.startswith("VmHWM:"))
        return int(line.split()[1]) / 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


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
            [sys.executable, __file__, "--all-frames"],
            env={**os.environ, "USBENCH_CACHE": folder},
            check=True,
            capture_output=True,
            text=True,
        ).stdout
    probe_plane, both, peak = map(float, output.split())
    yield "all 216 PP frames from nothing", f"{probe_plane:.1f} s", "at most 90 s"
    yield "all 162 FP and 216 PP frames from nothing", f"{both:.1f} s", "at most 40 s"
    yield "peak memory of that process", f"{peak:.0f} MB", "at most 700 MB"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--all-frames", action="store_true", help="only simulate all frames, in this process")
    parser.add_argument(
        "--throughput", action="store_true", help="only few and many scatterers, in this process"
    )
    parser.add_argument(
        "--repeats", type=int, default=15, help="frames per focal depth and round (default 15)"
    )
    args = parser.parse_args()
    if args.all_frames:
        all_frames()
        return
    if args.throughput:
        for row in chain(few_points(), break_even(), throughput(), dense_to_the_edge()):
            print(*row, sep="\t", flush=True)
        return
    table = Table("what", "measured", "asked", title="The simulator")
    parts = [accuracy(), engines(), speed(args.repeats), environments(args.repeats), scaling(), apart()]
    parts.append(from_nothing())
    has_esdiva = importlib.util.find_spec("esdiva") is not None
    if has_esdiva:
        parts.append(ratio())
    has_zea = importlib.util.find_spec("zea") is not None
    if has_zea:
        parts.append(ratio_to_zea())
    for part in parts:
        for row in part:
            table.add_row(*row)
            print(*row, sep="\t", file=sys.stderr, flush=True)  # the whole takes half an hour
        table.add_section()
    Console(width=110).print(table)
    if not has_esdiva:
        print("No ratio to esdiva: it is not installed (pip install -e '.[bench]').")
    if not has_zea:
        print("No ratio to zea: it is not installed (pip install zea==0.1.8).")


if __name__ == "__main__":
    main()
