"""CPU time that the parts of a trial take, also over several starts.

Wall time would tell who else uses the machine.
"""

import contextlib
import time
from collections.abc import Iterator, Mapping


class Stopwatch:
    """CPU seconds of this process by name; what runs now counts up to now."""

    def __init__(self) -> None:
        """Start with no seconds of anything."""
        self._seconds: dict[str, float] = {}
        self._since: dict[str, float] = {}

    @contextlib.contextmanager
    def timed(self, name: str) -> Iterator[None]:
        """Add the CPU seconds that are used to `name`."""
        self._since[name] = time.process_time()
        try:
            yield
        finally:
            self.add({name: time.process_time() - self._since.pop(name)})

    def add(self, seconds: Mapping[str, float]) -> None:
        """Add seconds that were counted elsewhere."""
        for name, value in seconds.items():
            self._seconds[name] = self._seconds.get(name, 0.0) + value

    def seconds(self) -> dict[str, float]:
        """Return the seconds so far."""
        now = time.process_time()
        running = {name: now - since for name, since in self._since.items()}
        return {
            name: self._seconds.get(name, 0.0) + running.get(name, 0.0) for name in self._seconds | running
        }
