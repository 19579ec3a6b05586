"""Time, memory and likeness, as the rows of the simulator's table need them."""

from __future__ import annotations

import os
import re
import resource
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import numpy.typing as npt

from usbench.envs.field.response_table import forget_tables

ROOT = Path(__file__).parents[2]
EXTRACT = ROOT / "tests" / "reference" / "rf_reference.npz"
ALL_LINES = ROOT.parent / "shared" / "reference" / "rf_reference.npz"
REFERENCE = ALL_LINES if ALL_LINES.exists() else EXTRACT
Row = tuple[str, str, str]  # what, measured, asked
Floats = npt.NDArray[np.float64]


def reached(measured: str, asked: str) -> str:
    """Return whether a number is what is asked for, "at least" or "at most" a bound; nothing without one."""
    if not measured or not asked:
        return ""
    number, bound = (float(re.search(r"[\d.]+", text)[0]) for text in (measured, asked))  # type: ignore[index]
    return "yes" if (number >= bound if asked.startswith("at least ") else number <= bound) else "no"


def correlation(a: Floats, b: Floats) -> float:
    """Return the normalised correlation of two signals of the same shape."""
    return float((a * b).sum() / np.sqrt(np.square(a).sum() * np.square(b).sum()))


def seconds(work: Callable[[], object]) -> float:
    """Return the wall time of a call."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def median_seconds(work: Callable[[], object], n: int) -> float:
    """Return the median wall time of `n` calls."""
    return statistics.median(seconds(work) for _ in range(n))


def cpu_seconds(work: Callable[[], object]) -> float:
    """Return the CPU time of a call, of all cores."""
    start = time.process_time()
    work()
    return time.process_time() - start


def peak_memory_mb() -> float:
    """Return the peak memory of this process; where Linux tells it, without what its parent had."""
    status = Path("/proc/self/status")
    if status.exists():
        (line,) = (line for line in status.read_text().splitlines() if line.startswith("VmHWM:"))
        return int(line.split()[1]) / 1024
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (2**20 if sys.platform == "darwin" else 1024)  # bytes on macOS, else kB


@contextmanager
def no_tables() -> Iterator[None]:
    """Without tables of responses: none in memory, none on disk."""
    kept = os.environ.get("USBENCH_CACHE")
    with tempfile.TemporaryDirectory() as folder:
        os.environ["USBENCH_CACHE"] = folder
        forget_tables()
        try:
            yield
        finally:
            del os.environ["USBENCH_CACHE"]
            os.environ.update({} if kept is None else {"USBENCH_CACHE": kept})
