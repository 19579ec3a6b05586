"""What Stable-Baselines3 has to be told beside a row: senses, several environments, returns of n steps."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from usbench.agents.hyperparameters import Value
from usbench.agents.rows.entry import TRUNK, Entry

# The names of Stable-Baselines3's policies for observations that are dictionaries.
MULTI_INPUT = {
    "CnnPolicy": "MultiInputPolicy",
    "MlpPolicy": "MultiInputPolicy",
    "MlpLstmPolicy": "MultiInputLstmPolicy",
}


def with_senses(row: Entry) -> Entry:
    """Return a row for observations that are an image and senses: with its trunk, and senses beside."""
    if row.policy not in MULTI_INPUT:
        return row
    own = dict(row.policy_kwargs)
    trunk = own.get("features_extractor_class", TRUNK["features_extractor_class"])
    own["features_extractor_class"] = "usbench.agents.sensing_trunk:SensingTrunk"
    own["features_extractor_kwargs"] = {**own.get("features_extractor_kwargs", {}), "trunk": trunk}
    if row.policy == "CnnPolicy":  # it has no hidden layers by itself; SB3's policy for dictionaries has two
        own.setdefault("net_arch", [])
    kwargs = {**row.kwargs, **row.kwargs_with_senses}
    return replace(row, policy=MULTI_INPUT[row.policy], policy_kwargs=own, kwargs=kwargs)


def shared_out(hyperparameters: Mapping[str, Value], rollout: int, n_envs: int) -> dict[str, Value]:
    """Return hyperparameters with those that Stable-Baselines3 counts per environment shared out.

    Updates per step stay as they are: less often, or more at a time.

    Args:
        hyperparameters: As a row says them, for all environments together.
        rollout: The steps of a rollout of all environments; 0 where there is none.
        n_envs: How many environments learn in step.

    Raises:
        ValueError: If the environments cannot share the rollout evenly.
    """
    shared = dict(hyperparameters)
    if rollout:
        if rollout % n_envs:
            raise ValueError(f"n_steps must be a multiple of {n_envs} environments, not {rollout}.")
        shared["n_steps"] = rollout // n_envs
    if "gradient_steps" in shared:
        train_freq = int(shared.get("train_freq", 1))
        common = math.gcd(train_freq, n_envs)
        shared["gradient_steps"] = int(shared["gradient_steps"]) * (n_envs // common)
        shared |= {"train_freq": train_freq // common} if "train_freq" in shared else {}
    return shared


def with_n_steps(model: Any) -> Any:
    """Return the model with a buffer for its n-step returns, which SB3 drops where a row has a buffer."""
    if getattr(model, "n_steps", 1) == 1 or not hasattr(model, "replay_buffer_class"):
        return model
    from usbench.agents.frame_buffer import FrameReplayBuffer
    from usbench.agents.value_based.n_step_buffer import NStepFrameBuffer

    if model.replay_buffer_class is FrameReplayBuffer:
        model.replay_buffer_class = NStepFrameBuffer
        model.replay_buffer = NStepFrameBuffer(
            model.buffer_size,
            model.observation_space,
            model.action_space,
            model.device,
            model.n_envs,
            n_steps=model.n_steps,
            gamma=model.gamma,
            **model.replay_buffer_kwargs,
        )
    return model
