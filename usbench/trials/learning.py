"""One training, made anew or as a resume file has it: agent, environment, and what watches them."""

import contextlib
import logging
import threading
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.logger import configure
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv

from usbench.agents import model_state, zoo
from usbench.agents.vec_env import SB3VecEnv
from usbench.envs.observation import senses
from usbench.records import EPISODES, EVALUATIONS, Trial, TrialConfig
from usbench.records.journal import Journal
from usbench.setting import Setting
from usbench.trials import interruption, knowledge
from usbench.trials.callback import Progress, TrainingWatch
from usbench.trials.evaluation import Evaluator
from usbench.trials.recorder import Recorder, Report, VectorRecorder
from usbench.trials.resume_files import ResumeFiles
from usbench.trials.stopwatch import Stopwatch

log = logging.getLogger(__name__)


def make_agent(setting: Setting, algo: str, env: Any, seed: int, hyperparameters: Mapping[str, Any]) -> Any:
    """Make an agent; the one that sees the state is given the exact plan."""
    # On the CPU even where there is a GPU: same seed, same bits everywhere.
    model_class = zoo.model_class(algo)
    kwargs: dict[str, Any] = {"device": "cpu"} if issubclass(model_class, BaseAlgorithm) else {}
    if getattr(model_class, "sees_state", False):
        kwargs["policy"] = setting.planner()
    if getattr(model_class, "takes_symmetries", False):
        kwargs["symmetries"] = knowledge.symmetries(setting)
    if getattr(model_class, "takes_teacher", False):
        kwargs["teacher"] = knowledge.teacher(setting)
    if getattr(model_class, "takes_model", False):
        kwargs["model"] = knowledge.scene_model(setting)
    return zoo.make(algo, env, seed, hyperparameters, **kwargs)


def check_agent(setting: Setting, config: TrialConfig) -> None:
    """Make an agent of another package and throw it away: it may refuse the environment, before any frame."""
    if not zoo.is_of_the_package(config.algo):
        _, env = recorded(setting, config.n_envs, lambda facts: None)
        make_agent(setting, config.algo, env, seeds_of(config.seed, config.algo)[1], config.hyperparameters)


class Learning:
    """A training with all that changes while it goes on.

    Attributes:
        agent: The agent.
        watch: What follows it.
    """

    def __init__(
        self,
        trial: Trial,
        setting: Setting,
        evaluator: Evaluator,
        progress: Progress,
        resume_files: ResumeFiles,
        stopwatch: Stopwatch,
    ) -> None:
        """Make it anew, and open the trial's records for its episodes.

        Args:
            trial: Its record so far.
            setting: What the agent meets, as the trial records it.
            evaluator: What plays the evaluation episodes.
            progress: Is told what happens.
            resume_files: What a killed trial continues from is written there.
            stopwatch: Of the trial; what it has counted goes into resume files.
        """
        config = trial.config
        self._config, self._stopwatch, self._progress = config, stopwatch, progress
        self._resume_files: ResumeFiles | None = resume_files
        self._goes_on = False
        self._interruption = interruption.Interruption()
        with contextlib.ExitStack() as held:
            self._journals = tuple(
                held.enter_context(Journal(trial.folder / name)) for name in (EPISODES, EVALUATIONS)
            )
            self.watch = TrainingWatch(
                steps=config.steps,
                evaluation_points=trial.evaluation_points,
                evaluator=evaluator,
                score=trial.anchors.score,
                episodes=self._journals[0],
                evaluations=self._journals[1],
                progress=progress,
                boundary=self._keep,
            )
            self._recorder: Recorder | VectorRecorder
            vec_env: VecEnv
            self._recorder, vec_env = recorded(setting, config.n_envs, self.watch.on_episode)
            env_seed, agent_seed = seeds_of(config.seed, config.algo)
            self.agent = make_agent(setting, config.algo, vec_env, agent_seed, config.hyperparameters)
            # After the agent was made: SB3 hands its own seed to the environment there.
            vec_env.seed(env_seed)
            self._made_by = _made_by(trial)
            # Only now: what was opened for a start that fails is closed.
            self._held = held.pop_all()

    def put_back(self, content: Mapping[str, Any]) -> None:
        """Go on as the content of a resume file says.

        Raises:
            ValueError: If it was made otherwise, or the journals are not what they were then; anything else
                if it is not of this training at all.
        """
        different = [name for name, value in self._made_by.items() if content["made_by"].get(name) != value]
        if different:
            raise ValueError(f"it comes from a trial that differs in {' and '.join(different)}.")
        model_state.put_back(self.agent, content["agent"])
        observation = self._recorder.put_back(content["environment"])
        if isinstance(self._recorder, Recorder):
            observation = senses.batch([observation])
        # Where the budget cut a rollout off, the agent has not kept the last observation, nor needs it.
        learns_on = self.agent.num_timesteps < self._config.steps
        if learns_on and not senses.equal(observation, self.agent._last_obs):
            raise ValueError("it was made with other frames.")
        self.watch.put_back(content["watch"])
        # Only now that the file is known to be of use.
        for journal, mark in zip(self._journals, content["journals"], strict=True):
            journal.cut(mark)
        self._stopwatch.add(content["seconds"])
        # Last: whatever was made since the start has drawn from them.
        model_state.put_generators_back(self.agent, content["generators"])
        self._goes_on = True

    def learn(self, tensorboard: Path) -> None:
        """Let the agent learn what is left; one that is not Stable-Baselines3's is watched from outside.

        Raises:
            ValueError: If such an agent did not make exactly the steps that it was told.
        """
        steps = self._config.steps
        if isinstance(self.agent, BaseAlgorithm):
            logger = configure(str(tensorboard), ["tensorboard"])
            self._held.callback(logger.close)
            self.agent.set_logger(logger)
            left = steps - self.agent.num_timesteps if self._goes_on else steps
            with interruption.put_off(self._progress.stopping) as self._interruption:
                self.agent.learn(left, callback=self.watch, reset_num_timesteps=not self._goes_on)
            if self._interruption.is_asked:  # while the last resume file was written
                raise KeyboardInterrupt
            return
        self.watch.from_outside(self.agent)
        self.agent.learn(steps)
        if self._recorder.n_steps != steps:
            raise ValueError(
                f"{self._config.algo} made {self._recorder.n_steps} training steps instead of {steps}."
            )
        self.watch.num_timesteps = steps

    def close(self) -> None:
        """Close the records, and TensorBoard's events, whose thread would outlive the trial."""
        self._held.close()

    def _keep(self, at_end: bool) -> None:
        """Write a resume file if it is time; nothing here may change what is drawn or learned afterwards.

        Raises:
            KeyboardInterrupt: If somebody has asked for the end.
        """
        asked = self._interruption.is_asked
        if self._resume_files is not None and (at_end or asked or self._resume_files.due()):
            self._write_resume_file(self._resume_files)
        if asked:
            raise KeyboardInterrupt

    def _write_resume_file(self, resume_files: ResumeFiles) -> None:
        try:
            content = {
                "made_by": self._made_by,
                "seconds": self._stopwatch.seconds(),
                "journals": [journal.mark() for journal in self._journals],
                "watch": self.watch.state(),
                "environment": self._recorder.state(),
                "agent": model_state.state_of(self.agent),
                "generators": model_state.generators(self.agent),
            }
        except model_state.UnsavedError as error:
            log.warning("no resume files, so that a trial that is killed starts again from step 0: %s", error)
            self._resume_files = None
            return
        resume_files.write(self.agent.num_timesteps, content)


def _made_by(trial: Trial) -> dict[str, Any]:
    """Return what must be the same for the bits to be the same."""
    return {
        "versions": dict(trial.versions),
        "frames": asdict(trial.frames) if trial.frames else {},
        **machine(),
        "configuration": trial.config.hash,
        # Not of the training's bits, but of the records that go on.
        "evaluation_points": list(trial.evaluation_points),
        "code": trial.code,
    }


def recorded(setting: Setting, n_envs: int, report: Report) -> tuple[Recorder | VectorRecorder, VecEnv]:
    """Return what records the episodes of `n_envs` environments, and the environments as SB3 takes them.

    Each report has `step` too: how many steps all environments have made.
    """
    if n_envs == 1:
        recorder = Recorder(setting.make_env(), lambda facts: report({**facts, "step": recorder.n_steps}))
        return recorder, DummyVecEnv([lambda: recorder])
    envs = SB3VecEnv(setting.make_vec_env(n_envs, autoreset_mode=AutoresetMode.SAME_STEP))
    together = VectorRecorder(envs, report)
    return together, together


def seeds_of(trial_seed: int, algo: str) -> tuple[int, int]:
    """Return the seeds of the environment, which all algorithms share, and of the agent.

    The agent's seed also depends on the algorithm's name: two algorithms of one trial seed begin with
    networks that are independent of each other, and meet the same starts and the same noise.
    """
    of_env, of_agent, _ = np.random.SeedSequence(trial_seed).spawn(3)
    of_agent = np.random.SeedSequence(trial_seed, spawn_key=(*of_agent.spawn_key, *algo.encode()))
    return int(of_env.generate_state(1)[0]), int(of_agent.generate_state(1)[0])


@contextlib.contextmanager
def heard_once() -> Iterator[None]:
    """Leave out what TensorBoard's thread prints of a full disk: the next write raises it where it counts."""
    tell = threading.excepthook

    def pass_over(args: threading.ExceptHookArgs) -> None:
        if not issubclass(args.exc_type, OSError):
            tell(args)

    threading.excepthook = pass_over
    try:
        yield
    finally:
        threading.excepthook = tell


def machine() -> dict[str, Any]:
    """Return what of this machine decides the bits of a training, beside the versions of packages."""
    return {"processor": torch.backends.cpu.get_cpu_capability()}
