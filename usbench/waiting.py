"""Work that people wait for: what takes long says what it is, and how long it will take, through `logging`.

A library stays silent unless it is asked: `logging.basicConfig(level=logging.INFO)` shows the messages. The
command line writes them to the standard error.
"""

from __future__ import annotations

import logging
import threading
import time

LONG_S = 2.0
# Seconds of work that are measured before an estimate is made.
_MEASURED_S = 0.25

log = logging.getLogger(__name__)


class Waiting:
    """Work in parts that take about equally long, which is told of once if it takes longer than LONG_S."""

    def __init__(self, what: str, n_parts: int, at_once: int = 1) -> None:
        """Start now.

        Args:
            what: What is done, as the beginning of a sentence.
            n_parts: Number of parts.
            at_once: How many of them are done side by side.
        """
        self._what, self._n_parts, self._at_once = what, n_parts, at_once
        self._n_done, self._told = 0, False
        self._lock = threading.Lock()
        self._start = time.perf_counter()

    def done(self) -> None:
        """One more part is done: estimate the whole, and tell of it if that is long."""
        with self._lock:
            self._n_done += 1
            elapsed = time.perf_counter() - self._start
            if self._told or elapsed < _MEASURED_S or self._n_done < self._at_once:
                return
            self._told = True
            if self._n_done < self._n_parts:
                announce(self._what, elapsed * self._n_parts / self._n_done)


def announce(what: str, seconds: float) -> None:
    """Tell what is done and how long it will take altogether, if that is longer than LONG_S."""
    if seconds > LONG_S:
        log.info("%s: %s.", what, duration(seconds))


def duration(seconds: float) -> str:
    """Return about how long that is: "less than 10 s", "about 40 s", "about 3 min", "about 2.5 h"."""
    if seconds < 10:
        return "less than 10 s"
    if seconds < 95:
        return f"about {10 * round(seconds / 10)} s"
    return f"about {round(seconds / 60)} min" if seconds < 6000 else f"about {seconds / 3600:.1f} h"
