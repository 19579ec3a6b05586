"""The engine beside others: the one before it, esdiva (the Field II method) and zea."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from simulation.measuring import REFERENCE, ROOT, Row, correlation, median_seconds
from usbench.envs.bmode import DEFAULT_IMAGING
from usbench.envs.phantom import Phantom
from usbench.envs.pose import Pose
from usbench.envs.probe import DEFAULT_ARRAY
from usbench.envs.rf import simulate_iq, simulate_rf
from usbench.envs.scanner import view

# The last commit of the engine before.
OLD_ENGINE = "21a33ca"
ROUNDS = 4
ZEA_SHARE = 100  # of the scatterers, one in so many


def engines() -> Iterator[Row]:
    """Time the engine before and the present one in turns, each in its own process, tables made anew."""
    with tempfile.TemporaryDirectory() as folder:
        old = Path(folder) / "old"
        if not unpacked(OLD_ENGINE, Path(folder) / "source", old):
            yield f"the engine before (commit {OLD_ENGINE}): not in this copy's history", "", ""
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
        by = f"the engine before (commit {OLD_ENGINE}) over the present one, focus {depth} mm"
        asked = f"at least {2 if depth == 50 else 4}"
        yield f"time of a frame, {by}", f"{old_rest / rest:.2f}", asked
        yield f"time of a first frame, {by}", f"{old_first / first:.2f}", "at least 2"


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


def ratio() -> Iterator[Row]:
    """Time a frame of RF, and the same frame by esdiva immediately afterwards."""
    from simulation.peer import Peer

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
    yield "the same, RF: esdiva's time over ours", f"{theirs / ours:.0f}", "at least 1000"
    yield "the same, I/Q, all that an image needs: esdiva's time over ours", f"{theirs / baseband:.0f}", ""
    alike = correlation(rf.astype(np.float64), expected)
    yield "correlation of both signals", f"{alike:.5f}", "at least 0.998"


def ratio_to_zea() -> Iterator[Row]:
    """Time a frame of RF, and a share of the same frame by zea immediately afterwards."""
    from simulation.zea_frame import seconds as zea_seconds

    positions, amplitudes = Phantom().in_view(Pose(), *view(DEFAULT_ARRAY, DEFAULT_IMAGING))
    ours = median_seconds(lambda: simulate_rf(positions, amplitudes, DEFAULT_ARRAY, 0.05), 15)
    some = slice(None, None, ZEA_SHARE)
    theirs = zea_seconds(positions[some], amplitudes[some], DEFAULT_ARRAY, 0.05)
    whole = theirs * len(positions) / len(positions[some])
    what = f"{len(positions[some])} of {len(positions)} scatterers, 64 transmits, 192 elements"
    yield f"{what}: zea 0.1.8, PyTorch, CPU", f"{theirs:.1f} s", ""
    yield "zea's time for all of them, in proportion, over ours for 64 lines of RF", f"{whole / ours:.0f}", ""
