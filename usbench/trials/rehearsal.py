"""How long a trial will take, before it starts: a few updates of an agent that is then thrown away.

The rate of this machine as it is now counts, with all that a training does: frames are simulated or looked
up, the agent acts and learns. Nothing of a rehearsal is kept but frames, which have the same bits whenever
they are made; the trial's own agent seeds every generator again.
"""

import contextlib
import gc
import time
from collections.abc import Sequence
from typing import Any, NamedTuple

from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.utils import ConstantSchedule

from usbench import suite
from usbench.agents import zoo
from usbench.records import TrialConfig
from usbench.setting import Setting
from usbench.trials.callback import rollout_steps
from usbench.trials.evaluation import Evaluator
from usbench.trials.learning import make_agent, recorded, seeds_of

# A rehearsal ends with the first update after these seconds, without those of the first update, or after this
# share of the trial's steps.
LONGEST_S = 3.0
LARGEST_SHARE = 0.02
# Trials with fewer updates are not rehearsed.
FEWEST_UPDATES = 20
# Episodes of the evaluation that are played.
N_EPISODES = 4


class Seconds(NamedTuple):
    """How long something takes.

    Attributes:
        wall: On this machine with all that it does beside.
        cpu: Of all cores together.
    """

    wall: float
    cpu: float

    @classmethod
    def now(cls) -> "Seconds":
        """Return what the clocks say."""
        return cls(time.perf_counter(), time.process_time())

    def since(self, start: "Seconds", n: int) -> "Seconds":
        """Return the seconds of each of `n` equal parts of what began at `start`."""
        return Seconds((self.wall - start.wall) / n, (self.cpu - start.cpu) / n)

    def times(self, n: int) -> "Seconds":
        """Return the seconds of `n` of them."""
        return Seconds(n * self.wall, n * self.cpu)


def expected(
    config: TrialConfig,
    setting: Setting,
    episodes: Sequence[suite.EvaluationEpisode],
    n_evaluations: int,
) -> Seconds | None:
    """Return about how long training and evaluations will take.

    Args:
        config: Of the trial.
        setting: What its agent meets, with the frames of the evaluation prepared.
        episodes: Those of one evaluation, which is played twice, with sampled and with greedy actions.
        n_evaluations: How many evaluations there are.

    Returns:
        None for an agent that is not Stable-Baselines3's, and for a trial of fewer than 20 updates.
    """
    if not config.steps or not issubclass(zoo.model_class(config.algo), BaseAlgorithm):
        return None
    with contextlib.closing(Evaluator(setting, episodes[:N_EPISODES])) as evaluator:
        env_seed, agent_seed = seeds_of(config.seed, config.algo)
        _, vec_env = recorded(setting, config.n_envs, lambda facts: None)
        agent = make_agent(setting, config.algo, vec_env, agent_seed, config.hyperparameters)
        vec_env.seed(env_seed)
        rollout = rollout_steps(agent) or setting.guidance.n_steps
        if config.steps < FEWEST_UPDATES * rollout:
            return None
        each_step = _of_a_step(agent, config.steps)
        start = Seconds.now()
        evaluator.play(agent, checkpoint=0, step=0, deterministic=True)
        each_episode = Seconds.now().since(start, len(evaluator.episodes))
    # Agent and environments hold each other, and what they remember may be large.
    del agent, vec_env
    gc.collect()
    training, evaluation = (
        each_step.times(config.steps),
        each_episode.times(2 * n_evaluations * len(episodes)),
    )
    return Seconds(training.wall + evaluation.wall, training.cpu + evaluation.cpu)


def _of_a_step(agent: Any, steps: int) -> Seconds:
    """Return the seconds of a step of a training of `steps` steps, updates included."""
    # As for the most part of a training: the agent learns, and explores as little as at the end.
    if hasattr(agent, "learning_starts"):
        agent.learning_starts = 0
    if hasattr(agent, "exploration_schedule"):
        agent.exploration_schedule = ConstantSchedule(agent.exploration_final_eps)
    agent.set_logger(Logger(folder=None, output_formats=[]))
    pace = _Pace(steps)
    agent.learn(steps, callback=pace)
    return pace.seconds_per_step


class _Pace(BaseCallback):
    """Notes when each rollout begins, and ends the training when enough is known."""

    def __init__(self, steps: int) -> None:
        super().__init__()
        self._enough_steps = steps * LARGEST_SHARE
        self._noted: list[tuple[Seconds, int]] = []

    @property
    def seconds_per_step(self) -> Seconds:
        """Of all rollouts and updates but the first, which warms up, unless there is no other."""
        known = self._noted[1:] if len(self._noted) > 2 else self._noted
        (start, first), (end, last) = known[0], known[-1]
        return end.since(start, last - first)

    def _on_rollout_start(self) -> None:
        self._noted.append((Seconds.now(), self.num_timesteps))

    def _on_step(self) -> bool:
        end, last = self._noted[-1]
        # The first update may compile for many seconds, which later ones do not.
        is_long = len(self._noted) > 2 and end.wall - self._noted[1][0].wall >= LONGEST_S
        return not (len(self._noted) > 1 and (is_long or last >= self._enough_steps))
