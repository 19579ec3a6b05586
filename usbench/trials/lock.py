"""One process at a time for each trial."""

import contextlib
import logging
from collections.abc import Iterator
from pathlib import Path

from filelock import FileLock, Timeout

log = logging.getLogger(__name__)

FOLDER = ".locks"


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold the lock of the trial in `folder`, which another process may hold: then wait until it is free.

    The lock ends with its process, however that ends. Its file, empty, stays: removing it would let two
    processes hold it.

    Raises:
        OSError: If the lock's file cannot be made.
    """
    path = folder.parent / FOLDER / f"{folder.name}.lock"
    path.parent.mkdir(parents=True, exist_ok=True)
    lock = FileLock(path, timeout=0)
    try:
        lock.acquire()
    except Timeout:
        log.warning("another process runs the trial %s: waiting for it", folder.name)
        lock.acquire(timeout=-1, poll_interval=1.0)
    try:
        yield
    finally:
        lock.release()
