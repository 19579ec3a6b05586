"""One trial = (algorithm, task, noise, seed): prepare frames, train, evaluate, record."""

import contextlib
import platform
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.logger import configure
from stable_baselines3.common.vec_env import DummyVecEnv

from usbench import records, suite
from usbench.agents import zoo
from usbench.agents.hyperparameters import check_seed, unknown
from usbench.atomic import atomic_path
from usbench.envs import oracle
from usbench.envs.frames import frame_store
from usbench.envs.guidance import check_noise
from usbench.envs.pose import whole_number
from usbench.evaluation import Evaluator, Recorder
from usbench.journal import Journal
from usbench.records import ConfigurationError, TrialConfig
from usbench.training import Progress, Silent, TrainingWatch

PACKAGES = (
    "usbench",
    "gymnasium",
    "stable-baselines3",
    "sb3-contrib",
    "torch",
    "numpy",
    "scipy",
    "numba",
    "opencv-python-headless",
)
# Rows of the final table: what it is called there and the agent that plays it.
REFERENCES = {"random": "random", "optimal": "oracle"}


class TrialError(RuntimeError):
    """A trial that broke off; the message says where its records are and why."""


@dataclass(frozen=True)
class Result:
    """Where a trial left its records, and whether it had been finished before."""

    folder: Path
    skipped: bool


def resolve(
    algo: str,
    task: str,
    *,
    noise: float = 0.0,
    seed: int = 0,
    steps: int | None = None,
    preset: str | None = None,
    overrides: Mapping[str, Any] | None = None,
) -> TrialConfig:
    """Return the full configuration of a trial: every default filled in, every value checked.

    Raises:
        ConfigurationError: If a name is unknown or a value is not allowed; one sentence says which.
    """
    try:
        if task not in suite.TASKS:
            raise unknown("task", task, suite.TASKS)
        hyperparameters = zoo.hyperparameters(algo, task, preset=preset, overrides=overrides or {})
        noise = check_noise(noise)
        seed = check_seed(seed)
        steps = whole_number("steps", suite.TASKS[task].steps if steps is None else steps)
        if steps < 1:
            raise ValueError(f"steps must be a whole number of at least 1, not {steps}.")
    except (ValueError, TypeError) as error:
        raise ConfigurationError(str(error)) from error
    plain = suite.make_env(task, noise).unwrapped
    return TrialConfig(
        task=task,
        algo=algo,
        noise=noise,
        seed=seed,
        steps=steps if zoo.entry(algo).learns else 0,
        hyperparameters=hyperparameters,
        environment={
            "id": suite.TASKS[task].env_id,
            **{name: asdict(getattr(plain, name)) for name in ("phantom", "probe", "imaging")},
        },
    )


def prepare_frames(task: str, report: Callable[[int, int], None] | None = None) -> dict[str, Any]:
    """Simulate the frames of every pose that the task can reach, unless kept; return what identifies them."""
    plain: Any = suite.make_env(task).unwrapped
    states = suite.TASKS[task].guidance.states
    store = frame_store(plain.phantom, plain.probe, plain.imaging)
    store.prepare(states, report)
    return {"digest": store.digest(states), "poses": len(states)}


def run_trial(
    config: TrialConfig, out: Path, *, overwrite: bool = False, progress: Progress | None = None
) -> Result:
    """Run one trial and leave its records in `out`; a finished one is not run again unless `overwrite`.

    Raises:
        ConfigurationError: If `out` cannot be written.
        KeyboardInterrupt: After the state was kept; the status is then "interrupted".
        TrialError: If anything goes wrong while running; the status is then "failed" with the reason.
    """
    folder = out / config.folder_name
    if not overwrite and records.read_state(folder).get("status") == "finished":
        return Result(folder, skipped=True)
    # One thread per trial: as fast on frames of this size, and the bits do not depend on the machine.
    torch.set_num_threads(1)
    trial = _Trial(config, records.create(out, config), progress or Silent())
    trial.run()
    return Result(trial.folder, skipped=False)


class _Trial:
    """A trial while it runs: its folder, its models and the state that `trial.json` shows."""

    def __init__(self, config: TrialConfig, folder: Path, progress: Progress) -> None:
        self.config, self.folder, self.progress = config, folder, progress
        self.anchors = oracle.returns(config.task, config.noise)
        self.agent: Any = None
        self.timings: dict[str, float] = {}
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
            "timings": self.timings,
        }

    def score(self, mean_return: float) -> float:
        """Return the normalised score: 0 is a random hand, 1 is perfect."""
        return (mean_return - self.anchors.random) / (self.anchors.optimal - self.anchors.random)

    def run(self) -> None:
        """Do everything, and leave the true status behind whatever happens."""
        try:
            self._write()
            with self._timed("total_s"):
                self._frames()
                self._train_and_evaluate()
                self.state["references"] = {name: self._reference(algo) for name, algo in REFERENCES.items()}
            self._save_model()
            self._write("finished")
        except KeyboardInterrupt:
            self._give_up("interrupted", "stopped by the user")
            raise
        except Exception as error:
            reason = f"{type(error).__name__}: {' '.join(str(error).split())}"
            self._give_up("failed", reason)
            raise TrialError(f"the trial in {str(self.folder)!r} failed: {reason}") from error

    def _frames(self) -> None:
        with self._timed("frames_s"):
            self.state["frames"] = prepare_frames(self.config.task, self.progress.frames)
        self._write()

    def _train_and_evaluate(self) -> None:
        """Train for exactly the budget; every episode and every checkpoint goes into the journals."""
        config, folder = self.config, self.folder
        with (
            Journal(folder / records.EPISODES) as episodes,
            Journal(folder / records.EVALUATIONS) as evaluations,
        ):
            self.evaluator = Evaluator(config.task, config.noise, config.n_frames)
            watch = TrainingWatch(
                steps=config.steps,
                checkpoints=self.state["checkpoints"],
                evaluator=self.evaluator,
                score=self.score,
                episodes=episodes,
                evaluations=evaluations,
                progress=self.progress,
            )
            env = suite.make_env(config.task, config.noise, n_frames=config.n_frames)
            recorder = Recorder(env, watch.on_episode)
            vec_env = DummyVecEnv([lambda: recorder])
            env_seed, agent_seed, _ = np.random.SeedSequence(config.seed).spawn(3)
            self.agent = self._make(config.algo, vec_env, agent_seed, config.hyperparameters)
            # After the agent was made: SB3 hands its own seed to the environment there.
            vec_env.seed(int(env_seed.generate_state(1)[0]))
            if config.steps:
                with self._timed("training_s"):
                    self._learn(watch, recorder)
                self.timings["training_s"] -= watch.seconds
            watch.evaluate_due(self.agent)
            self.timings["evaluation_s"] = watch.seconds
            vec_env.close()

    def _learn(self, watch: TrainingWatch, recorder: Recorder) -> None:
        """Let the agent learn; one that is not Stable-Baselines3's is watched from outside.

        Raises:
            ValueError: If such an agent did not make exactly the steps that it was told.
        """
        steps = self.config.steps
        if isinstance(self.agent, BaseAlgorithm):
            self.agent.set_logger(configure(str(self.folder / "tensorboard"), ["tensorboard"]))
            self.agent.learn(steps, callback=watch)
            return
        watch.from_outside(self.agent)
        self.agent.learn(steps)
        if recorder.n_steps != steps:
            raise ValueError(f"{self.config.algo} made {recorder.n_steps} training steps instead of {steps}.")
        watch.num_timesteps = steps

    def _make(
        self, algo: str, env: Any, seed: np.random.SeedSequence, hyperparameters: Mapping[str, Any]
    ) -> Any:
        """Make an agent; the one that sees the state is given the exact plan."""
        # On the CPU even where there is a GPU: same seed, same bits everywhere.
        model_class = zoo.model_class(algo)
        kwargs: dict[str, Any] = {"device": "cpu"} if issubclass(model_class, BaseAlgorithm) else {}
        if getattr(model_class, "sees_state", False):
            kwargs["policy"] = oracle.policy(self.config.task, self.config.noise)
        return zoo.make(algo, env, int(seed.generate_state(1)[0]), hyperparameters, **kwargs)

    def _reference(self, algo: str) -> dict[str, float]:
        """Play the evaluation episodes with an agent that does not learn; return the means."""
        env = suite.make_env(self.config.task, self.config.noise)
        agent = self._make(algo, DummyVecEnv([lambda: env]), np.random.SeedSequence(0), {})
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
        self.state["status"] = status
        records.write_state(self.folder, self.state)

    @contextlib.contextmanager
    def _timed(self, name: str) -> Iterator[None]:
        """Add the seconds that pass to the timing `name`."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.timings[name] = self.timings.get(name, 0.0) + time.perf_counter() - start
