"""The folder of what is kept on disk: where it is, how it stays small, and how it is cleared."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

import platformdirs

from usbench.atomic import LEFT_BEHIND_S, remove_leftovers
from usbench.checks import ConfigurationError

_Contents = TypeVar("_Contents")


def cache_folder() -> Path:
    """Return where files are kept: USBENCH_CACHE, or the platform's folder for caches.

    Raises:
        ConfigurationError: If USBENCH_CACHE begins with the home of a user who is not known.
    """
    chosen = os.environ.get("USBENCH_CACHE")
    if not chosen:
        return platformdirs.user_cache_path("usbench")
    try:
        return Path(chosen).expanduser()
    except RuntimeError as error:
        raise ConfigurationError(
            f"USBENCH_CACHE must name a folder, not {chosen!r}: there is no such home."
        ) from error


def not_kept(what: str, error: OSError) -> str:
    """Return in a sentence that `what` cannot be written into the folder: the same of all files alike."""
    reason = error.strerror or str(error)
    return (
        f"{what} are not kept on disk, as {str(cache_folder())!r} takes none ({reason}): "
        "USBENCH_CACHE sets another folder."
    )


def mark_used(path: Path) -> None:
    """Let the file at `path` be dropped last."""
    with contextlib.suppress(OSError):  # a folder that can only be read serves as well
        os.utime(path)


@dataclass(frozen=True)
class Entry(Generic[_Contents]):
    """A file of the folder; `contents` is None if it is damaged, `used` the time of its last use (s)."""

    path: Path
    size: int
    used: float
    contents: _Contents | None


@dataclass(frozen=True)
class Kind:
    """Files of one kind in the folder, `<name>-<hash><suffix>`."""

    name: str
    suffix: str

    def path(self, key: str) -> Path:
        """Return the file of what has the hash `key`."""
        return cache_folder() / f"{self.name}-{key[:32]}{self.suffix}"

    def files(self, folder: Path) -> list[tuple[float, int, Path]]:
        """Return time of last use (s), size (bytes) and path of all in `folder`, the one used last first."""
        found = []
        for path in folder.glob(f"{self.name}-*{self.suffix}"):
            with contextlib.suppress(FileNotFoundError):  # another process has removed it
                status = path.stat()
                found.append((status.st_mtime, status.st_size, path))
        return sorted(found, reverse=True)

    def entries(self, read: Callable[[Path], _Contents]) -> list[Entry[_Contents]]:
        """Return all in the folder with what `read` finds in them, the one used last first."""
        found = []
        for used, size, path in self.files(cache_folder()):
            contents = None
            with contextlib.suppress(Exception):  # a damaged file raises nearly anything
                contents = read(path)
            found.append(Entry(path, size, used, contents))
        return found

    def clear(self) -> tuple[int, int]:
        """Remove all; return how many there were, and their bytes."""
        folder = cache_folder()
        files = self.files(folder)
        for _, _, path in files:
            path.unlink(missing_ok=True)
        self._remove_leftovers(folder)
        return len(files), sum(size for _, size, _ in files)

    def prune(self, kept: Path, max_bytes: int) -> None:
        """Drop what killed processes left, and the files used longest ago above `max_bytes`; `kept` stays."""
        self._remove_leftovers(kept.parent)
        total = 0
        for _, size, path in self.files(kept.parent):
            total += size
            if total > max_bytes and path != kept:
                with contextlib.suppress(OSError):  # where files that are read cannot be removed
                    path.unlink()

    def _remove_leftovers(self, folder: Path) -> None:
        """Remove files that a killed process began to write."""
        remove_leftovers(folder, f".{self.name}-*.part", LEFT_BEHIND_S)
