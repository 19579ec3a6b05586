"""An agent trained quickly: `usbench run` in a process of its own, so that the page stays quick."""

import contextlib
import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from usbench import records
from usbench.records import ConfigurationError, Trial
from usbench.records.journal import UNREADABLE, read_rows
from usbench.setting import Setting
from usbench.trials.configuration import resolve

# The zoo's quickest learner, and a number of steps after which it finds the goal.
ALGO, STEPS = "dqn", 3000
USBENCH = [sys.executable, "-P", "-m", "usbench"]


@dataclass(frozen=True)
class Progress:
    """How far a training is.

    Attributes:
        status: "idle" before the first training.
        task: The task on which the agent is trained.
        step: Training steps done.
        steps: Training steps to do.
        folder: Of the trial.
        reason: Why the training failed, a sentence; empty otherwise.
    """

    status: Literal["idle", "running", "finished", "failed"] = "idle"
    task: str = ""
    step: int = 0
    steps: int = STEPS
    folder: Path | None = None
    reason: str = ""


class QuickTraining:
    """At most one training at a time; if it is ended early, the next one goes on from its resume file.

    Attributes:
        progress: How far the training is, as of the last `update`.
    """

    def __init__(self, runs: Path) -> None:
        """Put trials into `runs`."""
        self.progress = Progress()
        self._runs = runs
        self._process: subprocess.Popen[str] | None = None
        # Those before, whose trials are finished; they may still draw figures.
        self._drawing: list[subprocess.Popen[str]] = []

    def start(self, setting: Setting) -> None:
        """Begin to train on a task with noise, unless a training is running.

        Raises:
            ConfigurationError: If scene or reward of `setting` are not those of its task.
        """
        self.update()
        if self.progress.status == "running":
            return
        if not can_train(setting):
            raise ConfigurationError("the guide trains with the default anatomy, probe and imaging alone.")
        task, noise = setting.task, setting.noise
        config = resolve(ALGO, task, noise=noise, steps=STEPS)
        command = ["run", "--algo", ALGO, "--task", task, "--noise", str(noise), "--steps", str(STEPS)]
        if self._process is not None:
            self._drawing.append(self._process)
        self._process = subprocess.Popen(
            [*USBENCH, *command, "--out", str(self._runs), "--quiet"],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,  # Ctrl-C is for the guide, which ends it
        )
        self.progress = Progress("running", task, folder=self._runs / config.folder_name)

    def update(self) -> None:
        """Read how far the training is from what it has recorded."""
        now = self.progress
        if now.status != "running" or now.folder is None or self._process is None:
            return
        ended = self._process.poll() is not None
        try:
            rows = read_rows(now.folder / records.EPISODES)
            trial = Trial.find(now.folder)
            now = replace(now, step=int(rows[-1]["step"]) if rows else 0)
        except (*UNREADABLE, KeyError, TypeError):  # damaged before, of which the process will tell
            trial = None
        # Not when the process ends: before that it draws figures of the trial.
        if trial is not None and trial.status == "finished":
            now = replace(now, status="finished")
        elif ended:
            lines = self._process.communicate()[1].strip().splitlines()
            now = replace(
                now,
                status="failed",
                reason=lines[-1].removeprefix("usbench: error: ") if lines else "it ended without a message.",
            )
        self.progress = now

    def close(self) -> None:
        """End the training; its records are kept. If that takes long, it ends by itself."""
        running = [*self._drawing, *([] if self._process is None else [self._process])]
        for process in running:
            process.terminate()
        for process in running:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.communicate(timeout=0.5)
        self._drawing, self._process = [], None


def can_train(setting: Setting) -> bool:
    """Return whether scene and reward of `setting` are those of its task, with which the guide trains.

    What the present agent sees and is told says nothing of the one that would be trained.
    """
    seen = {name: getattr(setting, name) for name in ("n_frames", "senses", "n_phantoms")}
    return setting == Setting(task=setting.task, noise=setting.noise, **seen)
