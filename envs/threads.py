"""How many threads the simulator uses; frames have the same bits for any number."""

from __future__ import annotations

import os


def n_threads() -> int:
    """Return USBENCH_THREADS, or the number of cores that this process may use."""
    text = os.environ.get("USBENCH_THREADS", "")
    if not text:
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if not text.isdecimal() or int(text) < 1:
        raise ValueError(f"USBENCH_THREADS must be a whole number from 1, not {text!r}.")
    return int(text)
