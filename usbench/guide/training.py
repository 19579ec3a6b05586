"""An agent trained quickly: `usbench run` in a process of its own, so that the page stays quick."""

import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from usbench import records
from usbench.records import Trial
from usbench.records.journal import read_rows
from usbench.trials.configuration import resolve

# The quickest learner of the zoo, and steps after which it knows its way.
ALGO, STEPS = "dqn", 3000
USBENCH = [sys.executable, "-P", "-m", "usbench"]


@dataclass(frozen=True)
class Progress:
    """How far a training is.

    Attributes:
        status: "idle" before the first training.
        task: What is trained on.
        step: Training steps done.
        steps: Of so many.
        folder: Of the trial.
        reason: Why it failed, a sentence; empty otherwise.
    """

    status: Literal["idle", "running", "finished", "failed"] = "idle"
    task: str = ""
    step: int = 0
    steps: int = STEPS
    folder: Path | None = None
    reason: str = ""


class QuickTraining:
    """At most one training at a time; one that was ended goes on from its last checkpoint another time."""

    def __init__(self, runs: Path) -> None:
        """Put trials into `runs`."""
        self._runs = runs
        self._process: subprocess.Popen[str] | None = None
        self._progress = Progress()

    def start(self, task: str, noise: float) -> None:
        """Begin to train on a task, unless a training is running.

        Raises:
            ConfigurationError: If the task is unknown or the noise is not allowed.
        """
        if self.progress().status == "running":
            return
        config = resolve(ALGO, task, noise=noise, steps=STEPS)
        command = ["run", "--algo", ALGO, "--task", task, "--noise", str(noise), "--steps", str(STEPS)]
        self.close()
        self._process = subprocess.Popen(
            [*USBENCH, *command, "--out", str(self._runs), "--quiet"],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,  # Ctrl-C is for the guide, which ends it
        )
        self._progress = Progress("running", task, folder=self._runs / config.folder_name)

    def progress(self) -> Progress:
        """Return how far the training is, read from what it has recorded."""
        now = self._progress
        if now.status != "running" or now.folder is None or self._process is None:
            return now
        ended = self._process.poll() is not None
        rows = read_rows(now.folder / records.EPISODES)
        trial = Trial.find(now.folder)
        now = replace(now, step=int(rows[-1]["step"]) if rows else 0)
        # Not when the process ends: before that it draws figures of the trial.
        if trial is not None and trial.status == "finished":
            now = replace(now, status="finished")
        elif ended:
            lines = self._process.communicate()[1].strip().splitlines()
            now = replace(now, status="failed", reason=lines[-1] if lines else "the training was ended.")
        self._progress = now
        return now

    def close(self) -> None:
        """End the training; what it has recorded is kept."""
        if self._process is None:
            return
        self._process.terminate()
        try:
            self._process.communicate(timeout=10)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.communicate()
        self._process = None
