"""The ranges in which the search looks for each algorithm's hyperparameters: one literal table.

A hyperparameter that is not named here keeps the value of the table of algorithms. Every algorithm is given
the same number of candidates. The bounds keep a trial at some minutes of one core.
"""

from dataclasses import dataclass

from usbench.agents.hyperparameters import Value


@dataclass(frozen=True)
class Log:
    """Any number from `low` to `high`, evenly over their orders of magnitude."""

    low: float
    high: float


@dataclass(frozen=True)
class Choice:
    """One of these values."""

    values: tuple[Value, ...]


GAMMA = Choice((0.8, 0.9, 0.95, 0.99))
GAE_LAMBDA = Choice((0.8, 0.9, 0.95, 0.97, 1.0))
Q_LEARNING: dict[str, Log | Choice] = {
    "learning_rate": Log(1e-5, 1e-3),
    "gamma": GAMMA,
    "batch_size": Choice((32, 64)),
    "train_freq": Choice((4, 8)),
    "target_update_interval": Choice((125, 250, 500, 1000)),
    "exploration_fraction": Choice((0.1, 0.2, 0.3, 0.5)),
    "exploration_final_eps": Choice((0.02, 0.05, 0.1)),
}
CLIPPED: dict[str, Log | Choice] = {
    "learning_rate": Log(1e-5, 1e-3),
    "gamma": GAMMA,
    "gae_lambda": GAE_LAMBDA,
    "n_steps": Choice((128, 256, 512)),
    "batch_size": Choice((32, 64, 128)),
    "n_epochs": Choice((2, 4, 6)),
    "clip_range": Choice((0.1, 0.2, 0.3)),
    "ent_coef": Log(1e-4, 1e-1),
}

SPACES: dict[str, dict[str, Log | Choice]] = {
    "vpg": {
        "learning_rate": Log(1e-5, 1e-3),
        "value_learning_rate": Log(1e-4, 1e-2),
        "n_steps": Choice((32, 64)),
        "n_value_steps": Choice((1, 3, 5)),
        "adam_beta1": Choice((0.0, 0.5, 0.9)),
    },
    "a2c": {
        "learning_rate": Log(1e-6, 1e-3),
        "gamma": GAMMA,
        "gae_lambda": GAE_LAMBDA,
        "n_steps": Choice((8, 16, 32, 64)),
        "ent_coef": Log(1e-4, 1e-1),
        "vf_coef": Choice((0.25, 0.5, 1.0)),
        "use_rms_prop": Choice((False, True)),
    },
    "ppo": CLIPPED,
    "dqn": Q_LEARNING,
    "qrdqn": Q_LEARNING,
    "trpo": {
        "learning_rate": Log(1e-4, 1e-2),
        "gamma": GAMMA,
        "gae_lambda": GAE_LAMBDA,
        "n_steps": Choice((256, 512)),
        "target_kl": Log(3e-3, 1e-1),
        "n_critic_updates": Choice((2, 4, 8)),
    },
    "recurrent_ppo": CLIPPED | {"learning_rate": Log(1e-4, 1e-2)},
}
