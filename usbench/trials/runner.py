"""One trial = (algorithm, task, noise, seed): prepare frames, train, evaluate, record."""

import contextlib
import gc
import hashlib
import logging
import platform
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch
from stable_baselines3.common.vec_env import DummyVecEnv

from usbench import records, suite
from usbench.atomic import atomic_path, remove_leftovers
from usbench.envs.anatomy import Anatomy
from usbench.envs.frames import frame_store
from usbench.records import TrialConfig, checksums
from usbench.records.journal import Journal
from usbench.trials import anatomy_record
from usbench.trials.callback import Progress, Silent
from usbench.trials.configuration import PACKAGES, resolve
from usbench.trials.evaluation import Evaluator
from usbench.trials.finished import is_finished
from usbench.trials.glibc_memory import keep_freed
from usbench.trials.learning import Learning, heard_once, machine, make_agent
from usbench.trials.lock import locked
from usbench.trials.resume_files import Checkpoints, interval
from usbench.trials.stopwatch import Stopwatch

__all__ = ["PACKAGES", "Result", "TrialError", "prepare_frames", "resolve", "run_trial"]

log = logging.getLogger(__name__)

# Rows of the final table: what it is called there and the agent that plays it.
REFERENCES = {"random": "random", "optimal": "oracle"}


class TrialError(RuntimeError):
    """A trial that broke off; the message says where its records are and why."""


@dataclass(frozen=True)
class Result:
    """Where a trial left its records, and whether it had been finished before."""

    folder: Path
    skipped: bool


def prepare_frames(
    task: str, report: Callable[[int, int], None] | None = None, anatomy: Anatomy | None = None
) -> dict[str, Any]:
    """Simulate the frames of every pose that the task can reach, unless kept; return what identifies them.

    They are those of the evaluation's phantoms, where training has others.
    """
    plain: Any = suite.make_env(task, anatomy=anatomy).unwrapped
    states = suite.TASKS[task].guidance.states
    phantoms = suite.evaluation_phantoms(task, anatomy)
    digests = []
    for number, phantom in enumerate(phantoms):
        store = frame_store(phantom, plain.probe, plain.imaging)
        store.prepare(states, report and partial(_of_all, report, number, len(phantoms)))
        digests.append(store.digest(states))
    together = digests[0] if len(digests) == 1 else hashlib.sha256("".join(digests).encode()).hexdigest()
    return {"digest": together, "poses": len(phantoms) * len(states)}


def _of_all(report: Callable[[int, int], None], number: int, count: int, done: int, total: int) -> None:
    """Report that the phantoms before `number` are done, of `count` of them with `total` frames each."""
    report(number * total + done, count * total)


def run_trial(
    config: TrialConfig, out: Path, *, overwrite: bool = False, progress: Progress | None = None
) -> Result:
    """Run one trial and leave its records in `out`; one that was ended goes on from its last checkpoint.

    A finished one is not run again unless `overwrite`; one that another process runs is waited for.

    Raises:
        ConfigurationError: If `out` cannot be written.
        KeyboardInterrupt: After the state was kept; the status is then "interrupted".
        TrialError: If anything goes wrong while running; the status is then "failed" with the reason.
        ValueError: If the records of the trial in `out` are damaged.
    """
    folder = out / config.folder_name
    seconds = interval()
    if not overwrite and is_finished(config, out):
        return Result(folder, skipped=True)
    with contextlib.ExitStack() as held:
        try:
            held.enter_context(locked(folder))
        except OSError as error:
            raise records.unwritable(out, error) from error
        # Again: another process may have finished it meanwhile.
        if not overwrite and is_finished(config, out):
            return Result(folder, skipped=True)
        # One thread per trial: as fast on frames of this size, and the bits do not depend on the machine.
        torch.set_num_threads(1)
        keep_freed()
        trial = _Trial(config, out, Checkpoints(folder, seconds), progress or Silent())
        trial.run(anew=overwrite)
    # Models and environments hold each other: without this, the memory of a worker grows from trial to trial.
    del trial
    gc.collect()
    return Result(folder, skipped=False)


class _Trial:
    """A trial while it runs: its folder, its models and the state that `trial.json` shows."""

    def __init__(self, config: TrialConfig, out: Path, checkpoints: Checkpoints, progress: Progress) -> None:
        self.config, self.out, self.folder = config, out, out / config.folder_name
        self.checkpoints, self.progress = checkpoints, progress
        self.anatomy = anatomy_record.recorded(config.environment)
        if suite.TASKS[config.task].guidance.reward_from_frames:
            prepare_frames(config.task, self.progress.frames)  # before the anchors need them, in silence
        self.anchors = suite.anchors(config.task, config.noise, self.anatomy)
        self.agent: Any = None
        self.stopwatch = Stopwatch()
        self.state: dict[str, Any] = {
            "status": "running",
            "reason": None,
            "config": asdict(config),
            "anchors": asdict(self.anchors),
            "checkpoints": suite.checkpoints(config.task, config.steps),
            "evaluation_episodes": len(suite.evaluation_episodes(config.task)),
            "versions": {"python": platform.python_version(), **{name: version(name) for name in PACKAGES}},
            "platform": platform.platform(),
            "started": datetime.now(UTC).isoformat(timespec="seconds"),
        }

    def score(self, mean_return: float) -> float:
        """Return the normalised score: 0 is a random hand, 1 is perfect."""
        return (mean_return - self.anchors.random) / (self.anchors.optimal - self.anchors.random)

    def run(self, *, anew: bool) -> None:
        """Do everything, and leave the true status behind whatever happens."""
        goes_on = not anew and bool(self.checkpoints.paths())
        remove_leftovers(self.folder)
        if goes_on:
            self.state["started"] = records.read_state(self.folder).get("started", self.state["started"])
        else:
            self._create()
        try:
            self._write()
            with self.stopwatch.timed("total_s"):
                self._frames()
                self._train_and_evaluate(goes_on)
                self.state["references"] = {name: self._reference(algo) for name, algo in REFERENCES.items()}
            self._save_model()
            self.state["checksums"] = checksums.of(self.folder, (records.EPISODES, records.EVALUATIONS))
            self._write("finished")
        except KeyboardInterrupt:
            self._give_up("interrupted", "stopped by the user")
            raise
        except Exception as error:
            reason = f"{type(error).__name__}: {' '.join(str(error).split())}"
            self._give_up("failed", reason)
            raise TrialError(f"the trial in {str(self.folder)!r} failed: {reason}") from error
        self.checkpoints.clear()

    def _create(self) -> None:
        if records.read_state(self.folder).get("status", "finished") != "finished":
            log.warning("no checkpoint of the trial %s is of use: it starts from step 0", self.folder.name)
        records.create(self.out, self.config)

    def _frames(self) -> None:
        with self.stopwatch.timed("frames_s"):
            self.state["frames"] = prepare_frames(self.config.task, self.progress.frames, self.anatomy)
        self._write()

    def _train_and_evaluate(self, goes_on: bool) -> None:
        """Train for exactly the budget; every episode and every checkpoint goes into the journals."""
        self.evaluator = Evaluator(self.config.task, self.config.noise, self.config.n_frames, self.anatomy)
        for path, checkpoint in self.checkpoints.read() if goes_on else ():
            with self._journals() as journals:
                learning = self._learning(journals)
                try:
                    learning.put_back(checkpoint)
                except Exception as error:  # whatever a stranger's checkpoint says
                    log.warning("checkpoint %s is passed over: %s", path, " ".join(str(error).split()))
                    continue
                self.checkpoints.go_on_from(path)
                self._learn(learning)
                return
        if goes_on:
            self._create()
            self._write()
        with self._journals() as journals:
            self._learn(self._learning(journals))

    @contextlib.contextmanager
    def _journals(self) -> Iterator[tuple[Journal, Journal]]:
        with (
            Journal(self.folder / records.EPISODES) as episodes,
            Journal(self.folder / records.EVALUATIONS) as evaluations,
        ):
            yield episodes, evaluations

    def _learning(self, journals: tuple[Journal, Journal]) -> Learning:
        return Learning(
            self.config,
            evaluator=self.evaluator,
            planned=self.state["checkpoints"],
            score=self.score,
            progress=self.progress,
            journals=journals,
            checkpoints=self.checkpoints,
            stopwatch=self.stopwatch,
            machine={"versions": self.state["versions"], "frames": self.state["frames"], **machine()},
        )

    def _learn(self, learning: Learning) -> None:
        self.agent, watch = learning.agent, learning.watch
        with heard_once(), contextlib.closing(learning):
            if self.config.steps:
                with self.stopwatch.timed("training_s"):
                    learning.learn(self.folder / records.TENSORBOARD)
                self.stopwatch.add({"training_s": -watch.seconds})
            watch.evaluate_due(self.agent)
        self.stopwatch.add({"evaluation_s": watch.seconds})

    def _reference(self, algo: str) -> dict[str, float]:
        """Play the evaluation episodes with an agent that does not learn; return the means."""
        env = suite.make_env(self.config.task, self.config.noise, anatomy=self.anatomy)
        seed = np.random.SeedSequence(0)
        agent = make_agent(self.config, algo, DummyVecEnv([lambda: env]), seed, {})
        played = self.evaluator.play(agent, checkpoint=0, step=0, deterministic=False)
        return records.means(pd.DataFrame([episode.as_row() for episode in played]))

    def _save_model(self) -> None:
        if not hasattr(self.agent, "save"):
            return
        with atomic_path(self.folder / records.MODEL) as path:
            self.agent.save(path)

    def _give_up(self, status: str, reason: str) -> None:
        """Keep what there is; a full disk must not hide why the trial ended."""
        self.state["reason"] = reason
        with contextlib.suppress(OSError):
            self._write(status)
        with contextlib.suppress(OSError):
            if self.agent is not None:
                self._save_model()

    def _write(self, status: str = "running") -> None:
        self.state |= {"status": status, "timings": self.stopwatch.seconds()}
        records.write_state(self.folder, self.state)
