"""The tasks of the benchmark with all that follows from their rows: environments, episodes, anchors."""

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from types import MappingProxyType
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import load_env_creator

from usbench.envs import oracle
from usbench.envs.anatomy import Anatomy
from usbench.envs.pose import Pose
from usbench.envs.task import Task as GuidanceTask
from usbench.envs.tasks.random_phantoms import FIRST_HELD_OUT
from usbench.envs.tissue import Tissue
from usbench.envs.wrappers import ImageStack, NormalizeImage
from usbench.tasks import PAPER, ROWS, Row

# Evaluation seeds have 64 bits and training seeds 32 (SB3's `seed`): the two never meet.
EVALUATION_ENTROPY = 20_190_000

__all__ = [
    "PAPER",
    "TASKS",
    "EvaluationEpisode",
    "Task",
    "anchors",
    "checkpoints",
    "evaluation_episodes",
    "evaluation_phantoms",
    "make_env",
]


@dataclass(frozen=True, kw_only=True)
class Task(Row):
    """A row of the table, and the task that its environment sets.

    Attributes:
        guidance: Title, actions, starts, noise and reward of the environment.
    """

    guidance: GuidanceTask


@dataclass(frozen=True)
class EvaluationEpisode:
    """One entry of the fixed evaluation list: its number, the environment's seed, start pose and phantom.

    The phantom is None where the environment has but one.
    """

    number: int
    seed: int
    start: Pose
    phantom: int | None = None

    @property
    def options(self) -> dict[str, int]:
        """Start pose and phantom as `reset` takes them."""
        return asdict(self.start) | ({} if self.phantom is None else {"phantom": self.phantom})


def _guidance(row: Row) -> GuidanceTask:
    environment: Any = load_env_creator(row.entry_point)
    return environment.task  # type: ignore[no-any-return]


TASKS: Mapping[str, Task] = MappingProxyType(
    {name: Task(**asdict(row), guidance=_guidance(row)) for name, row in ROWS.items()}
)


def evaluation_episodes(task: str) -> tuple[EvaluationEpisode, ...]:
    """Return the fixed evaluation list of a task: its starts, `repeats` times, with phantoms taking turns."""
    row = TASKS[task]
    known = row.guidance.starts
    if row.drawn_starts:
        order = np.random.default_rng(EVALUATION_ENTROPY).permutation(len(known))
        known = tuple(known[k] for k in order[: row.drawn_starts])
    starts = [start for start in known for _ in range(row.repeats)]
    seeds = np.random.SeedSequence(EVALUATION_ENTROPY).generate_state(len(starts), np.uint64)
    held_out: list[int | None] = [FIRST_HELD_OUT + k for k in range(row.phantoms)]
    phantoms = held_out or [None]
    return tuple(
        EvaluationEpisode(number, int(seed), start, phantoms[number % len(phantoms)])
        for number, (seed, start) in enumerate(zip(seeds, starts, strict=True))
    )


def evaluation_phantoms(task: str, anatomy: Anatomy | None = None) -> tuple[Tissue, ...]:
    """Return the phantoms of a task's evaluation, one's own `anatomy` if there is one."""
    plain: Any = make_env(task, anatomy=anatomy).unwrapped
    numbers = range(FIRST_HELD_OUT, FIRST_HELD_OUT + TASKS[task].phantoms)
    return tuple(plain.phantoms.phantom(number) for number in numbers) or (plain.phantom,)


def anchors(task: str, noise: float, anatomy: Anatomy | None = None) -> oracle.Returns:
    """Return what the optimum, a random and an idle hand expect of an evaluation episode, exactly.

    The mean over the list of what each episode's phantom and start promise. Where every start is in it and
    the phantom is the paper's, that is the mean over the starts.
    """
    row = TASKS[task]
    if not row.phantoms and not row.drawn_starts:
        target = oracle.PAPER_TARGET if anatomy is None else anatomy.target
        return oracle.returns(task, noise, target=target)
    phantoms, starts = evaluation_phantoms(task, anatomy), defaultdict(list)
    for episode in evaluation_episodes(task):
        starts[phantoms[(episode.phantom or FIRST_HELD_OUT) - FIRST_HELD_OUT].target].append(episode.start)
    found = [
        asdict(oracle.returns(row.guidance, noise, target=target, starts=tuple(own)))
        for target, own in starts.items()
    ]
    weights = [len(own) for own in starts.values()]
    return oracle.Returns(
        **{name: float(np.average([one[name] for one in found], weights=weights)) for name in found[0]}
    )


def checkpoints(task: str, steps: int) -> tuple[int, ...]:
    """Return the training steps at which a trial of `steps` steps is evaluated, first 0 and last `steps`."""
    count = TASKS[task].checkpoints
    return tuple(sorted({steps * k // count for k in range(count + 1)}))


def make_env(
    task: str,
    noise: float = 0.0,
    *,
    n_frames: int = 4,
    reward: str = "normalized",
    anatomy: Anatomy | None = None,
    render_mode: str | None = None,
) -> gym.Env[Any, Any]:
    """Make the environment that every algorithm sees: plain environment, image stack, normalised pixels."""
    own: dict[str, Any] = {} if anatomy is None else {"phantom": anatomy}
    plain = gym.make(TASKS[task].env_id, noise=noise, reward=reward, render_mode=render_mode, **own)
    return NormalizeImage(ImageStack(plain, n_frames))
