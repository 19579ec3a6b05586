"""A training watched from outside: its episodes journalled, evaluated on the way, its budget kept."""

import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, Protocol

from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.type_aliases import TrainFrequencyUnit

from usbench.agents.model_state import has_diverged
from usbench.records import DIVERGED, Episode
from usbench.records.journal import Journal
from usbench.trials import tensorboard
from usbench.trials.evaluation import Evaluator

RECENT_EPISODES = 20


class Progress(Protocol):
    """What a trial tells while it runs."""

    def frames(self, done: int, total: int) -> None:
        """`done` of `total` frames are simulated."""

    def expected(self, wall_s: float, cpu_s: float) -> None:
        """Training and evaluations begin now, and take about `wall_s` and `cpu_s` of CPU time."""

    def training(self, step: int, steps: int, mean_return: float, score: float) -> None:
        """Training is at `step` of `steps`; mean return and normalised score of the last episodes."""

    def evaluated(self, step: int, mean_return: float, score: float) -> None:
        """The agent was evaluated at `step`; mean return and score of its greedy actions."""

    def stopping(self) -> None:
        """Somebody has asked for the end, which comes before the next rollout."""

    def close(self) -> None:
        """Nothing follows."""


class Silent:
    """A `Progress` that tells nothing."""

    def frames(self, done: int, total: int) -> None:
        """Say nothing."""

    def expected(self, wall_s: float, cpu_s: float) -> None:
        """Say nothing."""

    def training(self, step: int, steps: int, mean_return: float, score: float) -> None:
        """Say nothing."""

    def evaluated(self, step: int, mean_return: float, score: float) -> None:
        """Say nothing."""

    def stopping(self) -> None:
        """Say nothing."""

    def close(self) -> None:
        """Do nothing."""


class TrainingWatch(BaseCallback):
    """SB3 callback that follows one trial; `on_episode` is for the recorder around its environment.

    Attributes:
        seconds: CPU time of the evaluations so far.
    """

    def __init__(
        self,
        *,
        steps: int,
        evaluation_points: Sequence[int],
        evaluator: Evaluator,
        score: Callable[[float], float],
        episodes: Journal,
        evaluations: Journal,
        progress: Progress,
        boundary: Callable[[bool], None] = lambda at_end: None,
    ) -> None:
        """Watch a training of `steps` steps; `score` turns a mean return into a normalised score.

        `boundary` is called before every rollout of an SB3 agent, with False, and after the last, with True.
        """
        super().__init__()
        self.seconds = 0.0
        self._steps, self._due = steps, list(evaluation_points)
        self._evaluator, self._score, self._progress = evaluator, score, progress
        self._episodes, self._evaluations = episodes, evaluations
        self._boundary = boundary
        self._count = 0
        self._recent: deque[float] = deque(maxlen=RECENT_EPISODES)
        self._unaware: Any = None

    def state(self) -> dict[str, Any]:
        """Return what it counts, as plain data; what it journals is kept by the journals."""
        return {
            "due": list(self._due),
            "count": self._count,
            "recent": list(self._recent),
            "seconds": self.seconds,
        }

    def put_back(self, state: dict[str, Any]) -> None:
        """Go on counting from what `state` gave."""
        self._due, self.seconds = state["due"], state["seconds"]
        self._count = state["count"]
        self._recent.extend(state["recent"])

    def on_episode(self, facts: dict[str, Any]) -> None:
        """Journal one training episode."""
        row = {name: value for name, value in facts.items() if name != "actions"}
        self._episodes.append([Episode(episode=self._count, **row).as_row()])
        self._count += 1
        self._recent.append(facts["return_"])
        if self._unaware is not None:
            self.num_timesteps = facts["step"]
            self._tell()
            # After its last step it may still learn.
            if self.num_timesteps < self._steps:
                self.evaluate_due(self._unaware)

    def from_outside(self, agent: Any) -> None:
        """Watch an agent that knows no callback: now, and whenever an episode ends."""
        self._unaware = agent
        self.evaluate_due(agent)

    def evaluate_due(self, agent: Any) -> None:
        """If an evaluation point was reached, play the episodes, with sampled and with greedy actions.

        Raises:
            FloatingPointError: If the training has diverged: what the agent would play means nothing.
        """
        step = self.num_timesteps
        reached = [point for point in self._due if point <= step]
        if not reached:
            return
        if has_diverged(agent):
            raise FloatingPointError(DIVERGED)
        self._due = self._due[len(reached) :]
        # An agent of another package may have a logger of any kind.
        logger = getattr(agent, "logger", None) if self._steps > 0 else None
        logger = logger if isinstance(logger, Logger) else None
        start = time.process_time()
        rows = []
        for deterministic in (False, True):
            played = self._evaluator.play(
                agent, checkpoint=reached[-1], step=step, deterministic=deterministic
            )
            rows += [episode.as_row() for episode in played]
            mean = sum(episode.return_ for episode in played) / len(played)
            if logger is not None:
                mode = "deterministic" if deterministic else "stochastic"
                logger.record(f"evaluation/return_{mode}", mean)
                logger.record(f"evaluation/normalized_score_{mode}", self._score(mean))
            if deterministic:
                self._progress.evaluated(step, mean, self._score(mean))
        if logger is not None and isinstance(agent, BaseAlgorithm):
            tensorboard.evaluated(agent, played)
        if logger is not None:
            logger.dump(step)
        self._evaluations.append(rows)
        self.seconds += time.process_time() - start

    def _on_training_start(self) -> None:
        tensorboard.begin(self.logger)

    def _on_rollout_start(self) -> None:
        self.evaluate_due(self.model)
        self._boundary(False)

    def _on_training_end(self) -> None:
        self._boundary(True)

    def _tell(self) -> None:
        if self._recent:
            mean = sum(self._recent) / len(self._recent)
            self._progress.training(self.num_timesteps, self._steps, mean, self._score(mean))
            if self._unaware is None:
                tensorboard.trained(self.logger, self._score(mean))

    def _on_step(self) -> bool:
        self._tell()
        # Ending a rollout here leaves it out of training, so only one that would overrun the budget is ended.
        rollout = rollout_steps(self.model)
        return self.num_timesteps < self._steps or (rollout > 0 and self._steps % rollout == 0)


def rollout_steps(model: Any) -> int:
    """Return how many steps the algorithm collects before it learns from them, of all environments.

    0 if it collects whole episodes.
    """
    # Off-policy first: their `n_steps` is the length of n-step returns.
    if not hasattr(model, "train_freq"):
        return int(model.n_steps * model.n_envs)
    each, unit = model.train_freq
    return 0 if unit == TrainFrequencyUnit.EPISODE else int(each * model.n_envs)
