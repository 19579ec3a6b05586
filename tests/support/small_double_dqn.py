"""Double DQN with a small buffer and early updates, on a trivial environment."""

from signs import Signs
from stable_baselines3.common.vec_env import DummyVecEnv

from usbench.agents import zoo

SMALL = {"learning_starts": 16, "train_freq": 4, "batch_size": 16, "buffer_size": 1000}


def model(n_envs=1, **settings):
    env = DummyVecEnv([Signs] * n_envs)
    chosen = zoo.hyperparameters("double_dqn", "pp", SMALL | settings)
    return zoo.make("double_dqn", env, 3, chosen, device="cpu")
