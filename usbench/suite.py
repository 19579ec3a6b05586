"""The tasks of the benchmark, one literal row each: environment, step budget, evaluation episodes."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from types import MappingProxyType
from typing import Any

import gymnasium as gym
import numpy as np

import usbench  # noqa: F401  (registers the environments)
from usbench.envs.focal_point import FOCAL_POINT
from usbench.envs.guidance import Task as GuidanceTask
from usbench.envs.pose import Pose
from usbench.envs.probe_plane import PROBE_PLANE
from usbench.envs.wrappers import ImageStack, NormalizeImage

# Evaluation seeds have 64 bits and training seeds 32 (SB3's `seed`): the two never meet.
EVALUATION_ENTROPY = 20_190_000


@dataclass(frozen=True)
class Task:
    """One row of the suite.

    Attributes:
        env_id: Gymnasium id of the environment.
        guidance: Title, actions, starts, noise and reward of the environment.
        steps: Training budget in environment steps (251 updates of 64 steps in the paper).
        checkpoints: Evaluations after the one before training, spread evenly over the budget.
        repeats: Evaluation episodes from each start pose.
    """

    env_id: str
    guidance: GuidanceTask
    steps: int = 16_064
    checkpoints: int = 10
    repeats: int = 1


@dataclass(frozen=True)
class EvaluationEpisode:
    """One entry of the fixed evaluation list: its number, the environment's seed and the start pose."""

    number: int
    seed: int
    start: Pose

    @property
    def options(self) -> dict[str, int]:
        """The start pose as `reset` takes it."""
        return asdict(self.start)


TASKS: Mapping[str, Task] = MappingProxyType(
    {
        "fp": Task("usbench/FocalPoint-v0", FOCAL_POINT, repeats=6),
        "pp": Task("usbench/ProbePlane-v0", PROBE_PLANE, repeats=2),
    }
)


def evaluation_episodes(task: str) -> tuple[EvaluationEpisode, ...]:
    """Return the fixed evaluation list of a task: every start pose, `repeats` times."""
    starts = [start for start in TASKS[task].guidance.starts for _ in range(TASKS[task].repeats)]
    seeds = np.random.SeedSequence(EVALUATION_ENTROPY).generate_state(len(starts), np.uint64)
    return tuple(
        EvaluationEpisode(number, int(seed), start)
        for number, (seed, start) in enumerate(zip(seeds, starts, strict=True))
    )


def checkpoints(task: str, steps: int) -> tuple[int, ...]:
    """Return the training steps at which a trial of `steps` steps is evaluated, first 0 and last `steps`."""
    count = TASKS[task].checkpoints
    return tuple(sorted({steps * k // count for k in range(count + 1)}))


def make_env(
    task: str, noise: float = 0.0, *, n_frames: int = 4, render_mode: str | None = None
) -> gym.Env[Any, Any]:
    """Make the environment that every algorithm sees: plain environment, image stack, normalised pixels."""
    plain = gym.make(TASKS[task].env_id, noise=noise, render_mode=render_mode)
    return NormalizeImage(ImageStack(plain, n_frames))
