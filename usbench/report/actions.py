"""What a trained agent does in every pose. Agents are opened here, which takes torch."""

from dataclasses import asdict
from pathlib import Path

import numpy as np
import numpy.typing as npt
import torch

from usbench.envs.observation import senses
from usbench.setting import Setting
from usbench.trials import model_loading


def greedy(trial: Path) -> npt.NDArray[np.int64]:
    """Return the greedy action of a trial's agent in every state of its task, (n_states,).

    The agent must be one that learns. It sees what it sees at the start of an episode: the same frame in
    its whole stack.

    Raises:
        ConfigurationError: If there is no model that can be opened; one sentence says why.
    """
    torch.set_num_threads(1)  # as in training: the bits do not depend on the machine
    loaded = model_loading.load_agent(trial)
    setting = Setting.recorded(loaded.config)
    env = setting.make_env()
    states = setting.guidance.states
    seen = senses.batch([env.reset(options=asdict(pose))[0] for pose in states])
    env.close()
    first = np.ones(len(states), dtype=bool)
    actions, _ = loaded.agent.predict(seen, episode_start=first, deterministic=True)
    return np.asarray(actions, dtype=np.int64)
