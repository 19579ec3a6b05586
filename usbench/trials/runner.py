"""One trial = (algorithm, task, noise, seed): prepare frames, train, evaluate, record."""

import contextlib
import errno
import gc
import logging
import platform
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch
from filelock import Timeout
from stable_baselines3.common.vec_env import DummyVecEnv

from usbench import records, suite
from usbench.agents import zoo
from usbench.agents.model_state import has_diverged
from usbench.atomic import move_whole, scratch_folder
from usbench.records import Trial, TrialConfig, TrialError, checksums
from usbench.records.lock import locked
from usbench.setting import Setting
from usbench.trials import rehearsal
from usbench.trials.callback import Progress, Silent
from usbench.trials.configuration import versions
from usbench.trials.evaluation import Evaluator, explores
from usbench.trials.finished import find_finished
from usbench.trials.glibc_memory import keep_freed
from usbench.trials.learning import Learning, check_agent, heard_once, make_agent
from usbench.trials.resume_files import ResumeFiles, interval
from usbench.trials.stopwatch import Stopwatch
from usbench.words import in_one_line

log = logging.getLogger(__name__)

# Rows of the final table: what it is called there and the agent that plays it.
REFERENCES = {"random": "random", "optimal": "oracle"}


@dataclass(frozen=True)
class Result:
    """What became of a trial.

    Attributes:
        folder: Where its records are.
        skipped: Whether it had been finished before.
        has_other_code: Whether the code of its algorithm has changed since it was finished.
    """

    folder: Path
    skipped: bool
    has_other_code: bool = False


def run_trial(
    config: TrialConfig,
    out: Path,
    *,
    overwrite: bool = False,
    progress: Progress | None = None,
    rehearse: bool = False,
    evaluates_on_the_way: bool = True,
    waits: bool = True,
) -> Result:
    """Run one trial and leave its records in `out`; one that was ended goes on from its last resume file.

    A finished one is not run again unless `overwrite`; one that another process runs is waited for if
    `waits`. Where `rehearse`, a few updates beforehand tell `progress` how long it will take. Where it is not
    evaluated on the way, it is after its last step alone, and has no learning curve; training has the same
    bits.

    Raises:
        ConfigurationError: If `out` cannot be written.
        KeyboardInterrupt: After the state was kept; the status is then "interrupted".
        Timeout: If another process runs the trial, unless `waits`.
        TrialError: If anything goes wrong while running; the status is then "failed" with the reason.
        ValueError: If the records of the trial in `out` are damaged, unless `overwrite`.
    """
    folder, seconds = out / config.folder_name, interval()
    finished = None if overwrite else find_finished(config, out)
    if finished is None:
        with contextlib.ExitStack() as held:
            try:
                held.enter_context(locked(folder, waits=waits))
            except Timeout:  # an OSError, too
                raise
            except OSError as error:
                raise records.unwritable(out, error) from error
            # Again: another process may have finished it meanwhile.
            finished = None if overwrite else find_finished(config, out)
            if finished is None:
                points = suite.evaluation_points(config.task, config.steps)
                points = points if evaluates_on_the_way else points[-1:]
                files = ResumeFiles(folder, seconds)
                _run(config, out, points, files, progress or Silent(), anew=overwrite, rehearse=rehearse)
    if finished is not None:  # what a process left that was killed in its last moment
        ResumeFiles(folder, seconds).clear()
    # Trials of earlier versions have recorded no code.
    codes = ("", checksums.of_modules(zoo.modules(config.algo)))
    return Result(folder, finished is not None, finished is not None and finished.code not in codes)


def _run(
    config: TrialConfig,
    out: Path,
    evaluation_points: tuple[int, ...],
    resume_files: ResumeFiles,
    progress: Progress,
    *,
    anew: bool,
    rehearse: bool,
) -> None:
    # One thread per trial: as fast on frames of this size, and the bits do not depend on the machine.
    torch.set_num_threads(1)
    keep_freed()
    running = _Run(config, out, evaluation_points, resume_files, progress)
    running.run(anew=anew, rehearse=rehearse)
    # Models and environments hold each other: without this, the memory of a worker grows from trial to trial.
    del running
    gc.collect()


class _Run:
    """A trial while it runs: its folder, its models and the record that `trial.json` shows."""

    def __init__(
        self,
        config: TrialConfig,
        out: Path,
        evaluation_points: tuple[int, ...],
        resume_files: ResumeFiles,
        progress: Progress,
    ) -> None:
        self.config, self.out, self.folder = config, out, out / config.folder_name
        self.resume_files, self.progress = resume_files, progress
        self.setting = Setting.recorded(config)
        self.agent: Any = None
        self.stopwatch = Stopwatch()
        self.episodes = suite.evaluation_episodes(config.task)
        self.trial = Trial(
            folder=self.folder,
            status="running",
            config=config,
            anchors=self.setting.anchors(progress.frames),
            evaluation_points=evaluation_points,
            n_evaluation_episodes=len(self.episodes),
            versions=dict(versions()),
            platform=platform.platform(),
            started=datetime.now(UTC).isoformat(timespec="seconds"),
            code=checksums.of_modules(zoo.modules(config.algo)),
        )

    def run(self, *, anew: bool, rehearse: bool) -> None:
        """Do everything, and leave the true status behind whatever happens."""
        goes_on = not anew and bool(self.resume_files.paths())
        # What is overwritten is not read: it may be damaged.
        self._open_folder(goes_on, before=None if anew else Trial.find(self.folder))
        try:
            self._write()
            with self.stopwatch.timed("total_s"):
                if not goes_on:
                    check_agent(self.setting, self.config)
                self._frames()
                if rehearse and not goes_on:
                    self._rehearse()
                self._train_and_evaluate(goes_on)
                self._write(references={name: self._reference(algo) for name, algo in REFERENCES.items()})
            self._save_finished_model()
            files = checksums.of(self.folder, (records.EPISODES, records.EVALUATIONS))
            self._write(status="finished", checksums=files, explores=explores(self.agent))
        except KeyboardInterrupt:
            self._give_up("interrupted", "stopped by the user")
            raise
        except (Exception, SystemExit) as error:  # whatever an algorithm of another package does
            # An algorithm that meets such weights first lists them all.
            reason = records.DIVERGED if has_diverged(self.agent) else in_one_line(error, with_type=True)
            self._give_up("failed", reason)
            raise TrialError(f"the trial in {str(self.folder)!r} failed: {reason}") from error
        self.resume_files.clear()

    def _open_folder(self, goes_on: bool, before: Trial | None) -> None:
        """Make the folder, or take what the trial `before` in it has recorded of its start."""
        if goes_on and before is not None:
            self.trial = replace(self.trial, started=before.started)
        if goes_on:
            return
        episodes = self.folder / records.EPISODES
        if (
            before is not None
            and before.status != "finished"
            and episodes.is_file()
            and episodes.stat().st_size
        ):
            why = "no resume file is of use" if self.resume_files.paths() else "it left no resume file"
            log.warning("the trial %s starts from step 0: %s", self.folder.name, why)
        records.create(self.out, self.config)

    def _frames(self) -> None:
        if not zoo.entry(self.config.algo).looks:
            return
        with self.stopwatch.timed("frames_s"):
            frames = self.setting.prepare_frames(self.progress.frames)
        self.trial = replace(self.trial, frames=frames)

    def _rehearse(self) -> None:
        """Tell how long it will take, if that can be told; no trial ends because it cannot."""
        with self.stopwatch.timed("rehearsal_s"):
            try:
                points = len(self.trial.evaluation_points)
                expected = rehearsal.expected(self.config, self.setting, self.episodes, points)
            except (Exception, SystemExit) as error:  # whatever an algorithm of another package does
                log.warning("how long it will take is not known: %s", in_one_line(error))
                return
        if expected is not None:
            self.progress.expected(expected.wall, expected.cpu)

    def _train_and_evaluate(self, goes_on: bool) -> None:
        """Train for exactly the budget; every episode and every evaluation is recorded."""
        self.evaluator = Evaluator(self.setting, self.episodes)
        learning = self._resumed() if goes_on else None
        if learning is None and goes_on:
            self._open_folder(goes_on=False, before=Trial.find(self.folder))
            self._write()
        with contextlib.closing(learning or self._learning()) as learning:
            self._learn(learning)

    def _resumed(self) -> Learning | None:
        """Return what goes on from the newest resume file that is of use, None if there is none.

        No content of a file, which holds a replay buffer, outlives this: its memory is needed.
        """
        for path, content in self.resume_files.read():
            with contextlib.ExitStack() as unless_it_goes_on:
                learning = unless_it_goes_on.enter_context(contextlib.closing(self._learning()))
                try:
                    learning.put_back(content)
                except Exception as error:  # whatever a stranger's file says
                    log.warning("resume file %s is passed over: %s", path, in_one_line(error))
                    continue
                self.resume_files.go_on_from(path)
                unless_it_goes_on.pop_all()
                return learning
        return None

    def _learning(self) -> Learning:
        return Learning(
            self.trial, self.setting, self.evaluator, self.progress, self.resume_files, self.stopwatch
        )

    def _learn(self, learning: Learning) -> None:
        self.agent, watch = learning.agent, learning.watch
        with heard_once():
            if self.config.steps:
                with self.stopwatch.timed("training_s"):
                    learning.learn(self.folder / records.TENSORBOARD)
                self.stopwatch.add({"training_s": -watch.seconds})
            watch.evaluate_due(self.agent)
        self.stopwatch.add({"evaluation_s": watch.seconds})

    def _reference(self, algo: str) -> dict[str, float]:
        """Play the evaluation episodes with a reference policy; return the means."""
        seed = int(np.random.SeedSequence(0).generate_state(1)[0])
        agent = make_agent(self.setting, algo, DummyVecEnv([self.setting.make_env]), seed, {})
        played = self.evaluator.play(agent, checkpoint=0, step=0, deterministic=False)
        return records.means(pd.DataFrame([episode.as_row() for episode in played]))

    def _save_finished_model(self) -> None:
        """Save the model; where an agent of another package cannot, its records are as good without."""
        try:
            self._save_model()
        except (Exception, SystemExit) as error:  # whatever an algorithm of another package does
            # A full disk is no fault of the agent: with room on it, the trial goes on.
            disk = isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EIO)
            if disk or zoo.is_of_the_package(self.config.algo):
                raise
            self._tell_unsaved(error)

    def _save_model(self) -> None:
        """Let the agent save its model, in files that appear whole; a `save` may add a suffix to the name."""
        if not hasattr(self.agent, "save"):
            return
        with scratch_folder(self.folder / records.MODEL) as scratch:
            self.agent.save(scratch / records.MODEL)
            for path in scratch.iterdir():
                move_whole(path, self.folder / path.name)

    def _tell_unsaved(self, error: BaseException) -> None:
        log.warning(
            "the trial %s has no model: %s.save failed (%s)",
            self.folder.name,
            type(self.agent).__name__,
            in_one_line(error, with_type=True),
        )

    def _give_up(self, status: str, reason: str) -> None:
        """Keep what there is; a full disk must not hide why the trial ended."""
        with contextlib.suppress(OSError):
            self._write(status=status, reason=reason)
        if self.agent is None:
            return
        try:
            self._save_model()
        except (Exception, SystemExit) as error:  # whatever an algorithm of another package does
            self._tell_unsaved(error)

    def _write(self, **news: Any) -> None:
        self.trial = replace(self.trial, timings=self.stopwatch.seconds(), **news)
        self.trial.write()
