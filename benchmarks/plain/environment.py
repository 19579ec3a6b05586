"""The environment of every algorithm here, with Gymnasium's wrappers: the last four frames, normalised."""

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.wrappers import FrameStackObservation, TransformObservation

from usbench import suite
from usbench.envs.observation.wrappers import MEAN, STD


def make_env(task: str) -> gym.Env[Any, Any]:
    """The environment of `task` with observations (4, height, width), float32."""
    env = FrameStackObservation(gym.make(suite.TASKS[task].env_id), 4)
    space = gym.spaces.Box(-MEAN / STD, (255 - MEAN) / STD, env.observation_space.shape[:3], np.float32)
    return TransformObservation(env, lambda stack: ((stack[..., 0] - MEAN) / STD).astype(np.float32), space)
