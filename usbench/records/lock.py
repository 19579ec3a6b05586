"""One process at a time for what several may want to write: a trial, a study of a person, a table."""

import contextlib
import logging
from collections.abc import Iterator
from pathlib import Path

from filelock import FileLock, Timeout

log = logging.getLogger(__name__)

FOLDER = ".locks"


def lock_of(place: Path) -> FileLock:
    """Return the lock of a folder or a file, itself a file beside it; `Timeout` where another process has it.

    Raises:
        OSError: If the folder of the lock's file cannot be made.
    """
    path = place.parent / FOLDER / f"{place.name}.lock"
    path.parent.mkdir(parents=True, exist_ok=True)
    # A guide takes it in one thread and gives it back in another.
    return FileLock(path, timeout=0, thread_local=False)


def is_held(place: Path) -> bool:
    """Return whether another process holds the lock of a folder or a file.

    Raises:
        OSError: If the lock's file cannot be made.
    """
    try:
        with lock_of(place):
            return False
    except Timeout:
        return True


@contextlib.contextmanager
def locked(place: Path, *, waits: bool = True) -> Iterator[None]:
    """Hold the lock of a folder or a file; where another process has it, wait until it is free if `waits`.

    The lock ends with its process, however that ends. Its file, empty, stays: removing it would let two
    processes hold it.

    Raises:
        OSError: If the lock's file cannot be made.
        Timeout: If another process has the lock, unless `waits`.
    """
    lock = lock_of(place)
    try:
        lock.acquire()
    except Timeout:
        if not waits:
            raise
        log.warning("another process holds %s: waiting for it", place.name)
        lock.acquire(timeout=-1, poll_interval=1.0)
    try:
        yield
    finally:
        lock.release()
