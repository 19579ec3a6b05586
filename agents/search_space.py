"""The ranges in which the search looks for each row's hyperparameters, with their reasons, and the draws.

A hyperparameter that is not named here keeps the value of the table of algorithms. Reasons of the ranges that
several rows share:

* `learning_rate`: two orders of magnitude around 1e-4, Table II's value and near the default of each class.
* `gamma`: from 5 steps ahead to 100, where an episode has 16. Searched for every row, as it decides
  most: values settle near r / (1 - gamma), and the larger they are, the longer they take to learn.
* `gae_lambda`: Table II has 0.95 and 0.97; 1 is the plain return, and below 0.8 the value decides alone.
* `n_steps`: 1 to 32 episodes of 16 steps per update, as each class is meant: few for A2C and VPG, more where
  a rollout is used several times. Every batch size divides every rollout.
* `ent_coef`: from nothing to speak of to as much as a reward (about 1 per step) can outweigh.

The bounds keep a trial of the paper's budget at some minutes of one core.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from usbench.agents.hyperparameters import Value

# What the random agent is rewarded with per step, in both of the paper's tasks.
RANDOM_REWARD = -1.3


@dataclass(frozen=True)
class Log:
    """Any number from `low` to `high`, evenly over their orders of magnitude."""

    low: float
    high: float

    def draw(self, generator: np.random.Generator, drawn: Mapping[str, Value]) -> Value:
        """Return a number, rounded to three digits."""
        return float(f"{math.exp(generator.uniform(math.log(self.low), math.log(self.high))):.3g}")


@dataclass(frozen=True)
class Choice:
    """One of these values."""

    values: tuple[Value, ...]

    def draw(self, generator: np.random.Generator, drawn: Mapping[str, Value]) -> Value:
        """Return one of them, each as likely as the others."""
        return self.values[int(generator.integers(len(self.values)))]


@dataclass(frozen=True)
class Endless:
    """One of these rewards per step, collected without end: reward / (1 - gamma), with the gamma drawn."""

    rewards: tuple[float, ...]

    def draw(self, generator: np.random.Generator, drawn: Mapping[str, Value]) -> Value:
        """Return such a sum; `gamma` must have been drawn before."""
        reward = self.rewards[int(generator.integers(len(self.rewards)))]
        return round(reward / (1 - drawn["gamma"]), 6)


Space = Mapping[str, Log | Choice | Endless]

LEARNING_RATE = Log(1e-5, 1e-3)
GAMMA = Choice((0.8, 0.9, 0.95, 0.99))
GAE_LAMBDA = Choice((0.8, 0.9, 0.95, 0.97, 1.0))
ENTROPY = Log(1e-4, 1e-1)
Q_LEARNING: Space = {
    "learning_rate": LEARNING_RATE,
    "gamma": GAMMA,
    # DQN's 32 (Mnih et al. 2015), and its double.
    "batch_size": Choice((32, 64)),
    # One gradient step per 4 steps is Nature DQN's; per 8 halves the time.
    "train_freq": Choice((4, 8)),
    # 32 to 4 copies of the target network within a quarter of the budget.
    "target_update_interval": Choice((125, 250, 500, 1000)),
    # Of a budget of 16 064 steps: 100 to 500 episodes of exploration.
    "exploration_fraction": Choice((0.1, 0.2, 0.3, 0.5)),
    # DQN's 0.1 (Mnih et al. 2015), Stable-Baselines3's 0.05 for DQN, and 0.02, towards its 0.01 for QR-DQN.
    "exploration_final_eps": Choice((0.02, 0.05, 0.1)),
}
CLIPPED: Space = {
    "learning_rate": LEARNING_RATE,
    "gamma": GAMMA,
    "gae_lambda": GAE_LAMBDA,
    "n_steps": Choice((128, 256, 512)),
    # PPO's 64 (Schulman et al. 2017, its runs on MuJoCo), its half and its double.
    "batch_size": Choice((32, 64, 128)),
    # Stable-Baselines3's 10 would double the time of a trial.
    "n_epochs": Choice((2, 4, 6)),
    # The three values that the authors of PPO compared (Schulman et al. 2017, Table 1).
    "clip_range": Choice((0.1, 0.2, 0.3)),
    "ent_coef": ENTROPY,
}
# What Table II leaves open. Spinning Up's 80 value steps would take several times as long as any other row.
OPEN_IN_TABLE_II: Space = {
    "n_value_steps": Choice((1, 3, 5, 10)),
    # Adam's own 0.9 (Kingma and Ba 2014), about half of it, and no momentum, as RMSprop has it.
    "adam_beta1": Choice((0.0, 0.5, 0.9)),
}

SPACES: Mapping[str, Space] = MappingProxyType(
    {
        # Its value starts from nothing, or from all or half of what the random agent collects without end.
        "vpg": {**OPEN_IN_TABLE_II, "initial_value": Choice((0.0, -65.0, -130.0))},
        "vpg-tuned": {
            "learning_rate": LEARNING_RATE,
            # Ten times that of the policy, as in Table II.
            "value_learning_rate": Log(1e-4, 1e-2),
            "gamma": GAMMA,
            "gae_lambda": GAE_LAMBDA,
            "n_steps": Choice((32, 64, 128)),
            "initial_value": Endless((0.0, RANDOM_REWARD / 2, RANDOM_REWARD)),
            **OPEN_IN_TABLE_II,
        },
        "a2c": {
            "learning_rate": LEARNING_RATE,
            "gamma": GAMMA,
            "gae_lambda": GAE_LAMBDA,
            "n_steps": Choice((16, 32, 64, 128)),
            "ent_coef": ENTROPY,
            # Stable-Baselines3's 0.5, its half and its double.
            "vf_coef": Choice((0.25, 0.5, 1.0)),
            # RMSprop, as its authors took it (Mnih et al. 2016), or Adam, as in all other rows.
            "use_rms_prop": Choice((False, True)),
        },
        "ppo": CLIPPED,
        "dqn": Q_LEARNING,
        "qrdqn": Q_LEARNING,
        "trpo": {
            # Of the value function alone; the policy's step follows from `target_kl`.
            "learning_rate": Log(1e-4, 1e-2),
            "gamma": GAMMA,
            "gae_lambda": GAE_LAMBDA,
            "n_steps": Choice((128, 256, 512)),
            # Around the 0.01 of its authors.
            "target_kl": Log(3e-3, 1e-1),
            # Below sb3-contrib's 10, each being a pass over the rollout, like an epoch of PPO.
            "n_critic_updates": Choice((2, 4, 8)),
        },
        # Ten times the rates of PPO: a weight has less effect with 64 features than with the trunk's 7040.
        "recurrent_ppo": {**CLIPPED, "learning_rate": Log(1e-4, 1e-2)},
    }
)


def candidates(row: str, n: int) -> tuple[dict[str, Value], ...]:
    """Return `n` different draws from the space of `row`, each independent of the others.

    The generator's seed is the row's name, so that every row has draws that no other row has. The first draws
    do not depend on `n`.

    Raises:
        ValueError: If the space holds fewer than `n` different candidates.
    """
    generator, found = np.random.default_rng(list(row.encode())), []
    for _ in range(100 * n):
        drawn: dict[str, Value] = {}
        for name, space in SPACES[row].items():
            drawn[name] = space.draw(generator, drawn)
        if drawn not in found:
            found.append(drawn)
        if len(found) == n:
            return tuple(found)
    raise ValueError(f"the search space of {row!r} holds {len(found)} different candidates, not {n}.")
