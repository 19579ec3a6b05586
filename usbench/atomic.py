"""Files that are there whole or not at all, whatever happens while they are written."""

import contextlib
import glob
import os
import shutil
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import IO

# A file is written in seconds: a temporary one that old was left behind by a process that was killed.
LEFT_BEHIND_S = 3600.0
# Held while the umask is asked for, which also sets it: it is the whole process's.
_ASKING = threading.Lock()


@contextlib.contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """Yield a name to write to; what was written appears at `path` whole or not at all, whatever happens."""
    remove_leftovers(path.parent, f".{glob.escape(path.name)}.*.part", LEFT_BEHIND_S)
    with _named_in_errors(path):
        descriptor, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=".part")
    os.close(descriptor)
    temporary = Path(name)
    try:
        yield temporary
        _sync(temporary)
        temporary.chmod(0o666 & ~_umask())
        temporary.replace(path)
    except BaseException:
        with contextlib.suppress(OSError):
            temporary.unlink()
        raise


@contextlib.contextmanager
def atomic_file(path: Path) -> Iterator[IO[bytes]]:
    """Open a file for writing that appears at `path` whole or not at all."""
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        yield file


@contextlib.contextmanager
def scratch_folder(path: Path) -> Iterator[Path]:
    """Yield an empty folder beside `path`, from which whole files can be moved there; it is gone afterwards.

    The folder is for writers that choose the names of their files themselves.
    """
    remove_leftovers(path.parent, f".{glob.escape(path.name)}.*.part", LEFT_BEHIND_S)
    with _named_in_errors(path):
        folder = Path(tempfile.mkdtemp(dir=path.parent, prefix=f".{path.name}.", suffix=".part"))
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def move_whole(source: Path, path: Path) -> None:
    """Move a file or a folder to `path`, in place of what is there; a file is on the disk by then."""
    if path.is_dir():
        shutil.rmtree(path)
    if source.is_file():
        _sync(source)
    source.replace(path)


def remove_leftovers(folder: Path, pattern: str = ".*.part", older_s: float = 0.0) -> None:
    """Remove what killed writers left in `folder`, except what changed in the last `older_s` seconds."""
    for path in folder.glob(pattern):
        with contextlib.suppress(OSError):
            if time.time() - path.stat().st_mtime >= older_s:
                shutil.rmtree(path) if path.is_dir() else path.unlink()


@contextlib.contextmanager
def _named_in_errors(path: Path) -> Iterator[None]:
    """Let errors name `path`, which was asked for, rather than the temporary name beside it."""
    try:
        yield
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None


def _sync(path: Path) -> None:
    """Wait until a file is safe on the disk."""
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def _umask() -> int:
    """Return the process's umask; mkstemp's files are private whatever it says."""
    with _ASKING:
        current = os.umask(0o022)
        os.umask(current)
    return current
