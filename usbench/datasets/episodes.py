"""Episodes that are played for a data set: what the environment showed, what was done, what came of it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import gymnasium as gym
from stable_baselines3.common.vec_env import DummyVecEnv

from usbench import released
from usbench.checks import ConfigurationError, unknown
from usbench.coordinates import BY_NAME
from usbench.envs.observation.wrappers import ImageStack, NormalizeImage
from usbench.setting import Setting, of_any_version
from usbench.trials.evaluation import play_in_step
from usbench.trials.learning import make_agent
from usbench.trials.model_loading import load_agent

ORACLE, BEST, RANDOM, MIXED = "oracle", "best", "random", "mixed"
# In a mixed data set, episode after episode.
PARTS = (ORACLE, BEST, RANDOM)
# Episodes that are played side by side: one batch of observations for the agent.
AT_ONCE = 64
# What `info` says beside the pose.
FACTS = ("distance_mm", "is_success")


@dataclass
class Played:
    """One episode as it was played.

    Attributes:
        agent: Who acted.
        seed: With which the environment was reset.
        observations: As the environment shows them, without stacking and normalisation: one more than
            actions.
        actions: Greedy actions of an agent that learned.
        rewards: One for each action.
        terminated: Whether its end was that of the task.
        infos: The pose and `FACTS` by name, one more than actions: the truth, which no agent was told.
    """

    agent: str
    seed: int
    observations: list[Any] = field(default_factory=list)
    actions: list[int] = field(default_factory=list)
    rewards: list[float] = field(default_factory=list)
    terminated: bool = False
    infos: dict[str, list[Any]] = field(default_factory=dict)

    def saw(self, observation: Any, info: dict[str, Any]) -> None:
        """Keep what was seen, and what was true."""
        self.observations.append(observation)
        for name in (*(one for one in BY_NAME if one in info), *FACTS):
            self.infos.setdefault(name, []).append(info[name])


class _Watched(gym.Wrapper[Any, int, Any, int]):
    """Below stacking and normalisation, keeps what an environment shows in the episode that is played."""

    played: Played

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        observation, info = self.env.reset(seed=seed, options=options)
        self.played.saw(observation, info)
        return observation, info

    def step(self, action: int) -> Any:
        observation, reward, terminated, truncated, info = self.env.step(action)
        self.played.saw(observation, info)
        self.played.actions.append(int(action))
        self.played.rewards.append(float(reward))
        self.played.terminated = bool(terminated)
        return observation, reward, terminated, truncated, info


def make_env(setting: Setting) -> gym.Env[Any, Any]:
    """Make the environment whose observations are kept, as its id and these arguments alone make it."""
    by_default = Setting(task=setting.task).senses
    told: dict[str, Any] = {} if setting.senses == by_default else {"senses": list(setting.senses or ())}
    with of_any_version():
        env: gym.Env[Any, Any] = gym.make(setting.row.env_id, noise=setting.noise, **told)
    return env


def names(agent: str) -> tuple[str, ...]:
    """Return who acts in the episodes of a data set, one after the other."""
    return PARTS if agent == MIXED else (agent,)


def shown(name: str) -> str:
    """Return what a data set calls an agent: of a trial the name of its folder, not where that lies."""
    return Path(name).resolve().name if Path(name).is_dir() else name


def open_agent(name: str, setting: Setting, seed: int) -> tuple[Any, Setting]:
    """Return the agent `name` of the setting's task, and the setting with what it sees and is told.

    Args:
        name: "oracle", "best" or "random"; or a trial's folder, or the name of an agent of the package.
        setting: Task and noise.
        seed: Of the random agent.

    Raises:
        ConfigurationError: If there is no such agent, or it is of another task; one sentence says which.
    """
    if name in (ORACLE, RANDOM):
        env = DummyVecEnv([setting.make_env])
        return make_agent(setting, name, env, seed, {}), setting
    # An empty name would be the present folder.
    if name != BEST and not (name and released.place(name).exists()):
        known = (ORACLE, BEST, RANDOM, MIXED, *released.names())
        refused = str(unknown("agent", name, known)).removesuffix(".")
        raise ConfigurationError(f"{refused}, and the folder of a trial.")
    loaded = load_agent(f"{BEST}:{setting.task}" if name == BEST else released.place(name))
    recorded = Setting.recorded(loaded.config)
    _check_trained_on(recorded, setting, name)
    return loaded.agent, replace(setting, n_frames=recorded.n_frames, senses=recorded.senses)


def _check_trained_on(recorded: Setting, setting: Setting, name: str) -> None:
    """Raise ConfigurationError unless the agent `name`, with the setting `recorded`, is one of `setting`."""
    another = own = ""
    if recorded.task == setting.task:
        others = " and ".join(recorded.differences(setting))
        if not others:
            return
        another, own = f" with another {others}", f" with the task's own {others}"
    raise ConfigurationError(
        f"the agent {name!r} was trained on {recorded.task!r}{another}: a data set of {setting.task!r} is "
        f"played by agents that were trained on {setting.task!r}{own}."
    )


def play(agent: Any, name: str, setting: Setting, seeds: Sequence[int]) -> Iterator[Played]:
    """Yield an episode for each of `seeds`, played with greedy actions; the reward is the true one."""
    envs = [_Watched(make_env(setting)) for _ in seeds[:AT_ONCE]]
    shown = [NormalizeImage(ImageStack(env, setting.n_frames)) for env in envs]
    for start in range(0, len(seeds), AT_ONCE):
        episodes = [Played(name, int(seed)) for seed in seeds[start : start + AT_ONCE]]
        for env, episode in zip(envs, episodes, strict=False):
            env.played = episode
        starts = [{"seed": episode.seed} for episode in episodes]
        play_in_step(agent, shown[: len(episodes)], starts, deterministic=True)
        yield from episodes
    for one in shown:
        one.close()
