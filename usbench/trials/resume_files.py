"""Resume files of a training: whole or passed over, and none runs code when it is read.

A file is a line with name and format, the SHA-256 of what follows, and what `torch.save` makes of plain data.
It is read with `torch.load(weights_only=True)`, which makes numbers, texts and tensors and nothing else: the
checksum guards against accidents, this against strangers.
"""

import hashlib
import io
import logging
import os
import shutil
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import torch

from usbench.atomic import atomic_file, remove_leftovers
from usbench.records import CHECKPOINTS, ConfigurationError
from usbench.words import in_one_line

log = logging.getLogger(__name__)

INTERVAL = "USBENCH_CHECKPOINT_SECONDS"
# With one rollout and a training step on top, less than the minute of work that may be lost.
DEFAULT_SECONDS = 45.0
# The newest, and the one before it in case that one is found broken.
KEPT = 2
_HEADER = b"usbench checkpoint 1\n"
_DIGEST_SIZE = hashlib.sha256().digest_size


def interval() -> float:
    """Return the seconds between resume files, from the environment variable if it is set.

    Raises:
        ConfigurationError: If that is no number of at least 0.
    """
    text = os.environ.get(INTERVAL) or str(DEFAULT_SECONDS)
    try:
        seconds = float(text)
    except ValueError:
        seconds = -1.0
    if not seconds >= 0:  # also true for nan
        raise ConfigurationError(f"{INTERVAL} must be a number of seconds of at least 0, not {text!r}.")
    return seconds


class ResumeFiles:
    """The resume files of one trial, in a folder of their own inside the trial's."""

    def __init__(self, trial: Path, seconds: float) -> None:
        """Keep resume files of the trial in the folder `trial`, one in `seconds` at most."""
        self._folder, self._seconds = trial / CHECKPOINTS, seconds
        self._written = float("-inf")

    def paths(self) -> list[Path]:
        """Return the files that there are, newest first."""
        return sorted(self._folder.glob("*.pt"), reverse=True)

    def step(self) -> int:
        """Return the training step of the newest file, 0 where there is none."""
        return next((int(path.stem) for path in self.paths() if path.stem.isdigit()), 0)

    def due(self) -> bool:
        """Return whether it is time for the next one; the first is due at once."""
        return time.monotonic() - self._written >= self._seconds

    def write(self, step: int, content: dict[str, Any]) -> None:
        """Write the resume file of `step`; if the disk does not take it, say so and keep those before."""
        buffer = io.BytesIO()
        torch.save(content, buffer)
        payload = buffer.getvalue()
        try:
            self._folder.mkdir(exist_ok=True)
            with atomic_file(self._folder / f"{step:012d}.pt") as file:
                file.write(_HEADER + hashlib.sha256(payload).digest() + payload)
            for path in self.paths()[KEPT:]:
                path.unlink()
        except OSError as error:
            log.warning("no resume file at step %d: %s cannot be written (%s)", step, self._folder, error)
        self._written = time.monotonic()

    def read(self) -> Iterator[tuple[Path, dict[str, Any]]]:
        """Yield path and content of those that are whole, newest first; say which are not."""
        for path in self.paths():
            try:
                content = _read(path)
            except Exception as error:  # whatever stands in a stranger's file
                log.warning("resume file %s is passed over: %s", path, in_one_line(error))
            else:
                yield path, content

    def go_on_from(self, path: Path) -> None:
        """Remove those newer than `path`, which could not be used, and what killed writers left."""
        for folder in (self._folder.parent, self._folder):
            remove_leftovers(folder)
        for newer in self.paths()[: self.paths().index(path)]:
            newer.unlink()

    def clear(self) -> None:
        """Remove all of them."""
        shutil.rmtree(self._folder, ignore_errors=True)


def _read(path: Path) -> dict[str, Any]:
    data = path.read_bytes()
    start = len(_HEADER) + _DIGEST_SIZE
    if data[: len(_HEADER)] != _HEADER:
        raise ValueError("it does not begin as a resume file of this version does.")
    if hashlib.sha256(data[start:]).digest() != data[len(_HEADER) : start]:
        raise ValueError("its checksum differs, so it is damaged.")
    content = torch.load(io.BytesIO(data[start:]), map_location="cpu", weights_only=True)
    if not isinstance(content, dict):
        raise ValueError(f"it holds {type(content).__name__}, not what a resume file holds.")
    return content
