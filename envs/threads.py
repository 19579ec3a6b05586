"""How many threads the simulator uses; frames have the same bits for any number."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from typing import TypeVar

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")
_here = threading.local()


def n_threads() -> int:
    """Return USBENCH_THREADS, or the number of cores that this process may use; 1 within `in_parallel`."""
    if getattr(_here, "is_worker", False):
        return 1
    text = os.environ.get("USBENCH_THREADS", "")
    if not text:
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if not text.isdecimal() or int(text) < 1:
        raise ValueError(f"USBENCH_THREADS must be a whole number from 1, not {text!r}.")
    return int(text)


def divided(n: int) -> list[slice]:
    """Divide `n` items among the threads: one slice of neighbouring items per thread, at most `n` slices."""
    n_parts = max(1, min(n_threads(), n))
    return [slice(n * k // n_parts, n * (k + 1) // n_parts) for k in range(n_parts)]


def in_parallel(work: Callable[[_Item], _Result], items: Iterable[_Item]) -> list[_Result]:
    """Return `work(item)` of every item, in their order; of several, each uses one thread."""
    n, items = n_threads(), list(items)
    if n == 1 or len(items) == 1:  # an item alone may use all threads
        return [work(item) for item in items]
    return list(_pool(n).map(work, items))


# Kept, as to start threads takes a few hundredths of a frame's time, and far longer on a busy machine.
@lru_cache(maxsize=1)
def _pool(n: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(n, "usbench", initializer=_become_worker)


def _become_worker() -> None:
    _here.is_worker = True


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_pool.cache_clear)  # a child has no threads of its parent
