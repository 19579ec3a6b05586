"""All that a Stable-Baselines3 model holds between two rollouts, as plain data, and how it is put back.

`save` and `load` of Stable-Baselines3 leave out what is needed to go on with the same bits (replay buffer,
states of an LSTM, generators) and unpickle objects. Here everything is numbers, texts, arrays and lists of
them, which `torch.load(weights_only=True)` reads; the model itself is made anew from its configuration.
"""

import random
from collections import deque
from functools import partial
from types import FunctionType
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.type_aliases import TrainFreq
from stable_baselines3.common.utils import ConstantSchedule, FloatSchedule, LinearSchedule

# These are made from the configuration, or the parameters hold them (as they do `batch_norm_stats`).
MADE_ANEW = frozenset(
    {
        "device", "env", "_vec_normalize_env", "_logger", "_custom_logger",
        "observation_space", "action_space", "policy", "policy_kwargs",
        "q_net", "q_net_target", "quantile_net", "quantile_net_target", "batch_norm_stats",
        "batch_norm_stats_target", "rollout_buffer", "rollout_buffer_kwargs", "replay_buffer",
        "replay_buffer_kwargs",
    }
)  # fmt: skip
# So are values of these types, whatever their names.
_TYPES_MADE_ANEW = (type, FunctionType, partial, FloatSchedule, LinearSchedule, ConstantSchedule, TrainFreq)
_PLAIN = (type(None), bool, int, float, str, bytes)


class UnsavedError(TypeError):
    """A model holds something that cannot be written into a resume file."""


def state_of(model: BaseAlgorithm) -> dict[str, Any]:
    """All that `model` holds at the start of a rollout; tensors and arrays may share memory with the model.

    Raises:
        UnsavedError: the model holds something that is neither plain data nor made from the configuration.
    """
    _, variables = model._get_torch_save_params()
    return {
        "parameters": model.get_parameters(),
        "variables": {name: getattr(model, name) for name in variables},
        "attributes": _attributes(model),
        "replay_buffer": _replay_buffer(model),
    }


def put_back(model: BaseAlgorithm, state: dict[str, Any]) -> None:
    """Gives the newly made `model` what `state_of` took from one of the same configuration."""
    model.set_parameters(state["parameters"], device=model.device)
    for name, value in state["variables"].items():
        getattr(model, name).data = value.data
    for name, value in state["attributes"].items():
        setattr(model, name, _restored(value, getattr(model, name, None)))
    if state["replay_buffer"] is not None:
        model.replay_buffer.put_back(_restored(state["replay_buffer"]))  # type: ignore[attr-defined]


def generators(model: BaseAlgorithm) -> dict[str, Any]:
    """The states of all generators that a model draws from."""
    return {
        "python": _plain(random.getstate()),
        "numpy": _plain(np.random.get_state(legacy=False)),
        "torch": torch.get_rng_state(),
        "actions": model.action_space.np_random.bit_generator.state,
    }


def put_generators_back(model: BaseAlgorithm, states: dict[str, Any]) -> None:
    """Puts all generators that `model` draws from into the `states` that `generators` gave."""
    random.setstate(_restored(states["python"]))
    np.random.set_state(_restored(states["numpy"]))
    torch.set_rng_state(states["torch"])
    model.action_space.np_random.bit_generator.state = states["actions"]


def has_diverged(agent: Any) -> bool:
    """Whether a weight of the agent's networks is infinite or no number; False if it has none of torch."""
    policy = getattr(agent, "policy", None)
    if not isinstance(policy, torch.nn.Module):
        return False
    return not all(bool(torch.isfinite(weights).all()) for weights in policy.parameters())


def _attributes(model: BaseAlgorithm) -> dict[str, Any]:
    parameters, variables = model._get_torch_save_params()
    held = MADE_ANEW | {name.split(".")[0] for name in [*parameters, *variables]}
    attributes = {}
    for name, value in vars(model).items():
        # What `takes_teacher` and `takes_model` bring.
        if name in held or isinstance(value, _TYPES_MADE_ANEW) or getattr(model, f"takes_{name}", False):
            continue
        try:
            attributes[name] = _attribute(value)
        except TypeError as error:
            raise UnsavedError(f"{type(model).__name__}.{name} cannot be kept: {error}") from error
    return attributes


def _replay_buffer(model: BaseAlgorithm) -> Any:
    buffer = getattr(model, "replay_buffer", None)
    if buffer is None:
        return None
    if not hasattr(buffer, "put_back"):
        raise UnsavedError(
            f"a {type(buffer).__name__} would take too long to keep (a FrameReplayBuffer would not)."
        )
    return _plain(buffer.state())


def _attribute(value: Any) -> Any:
    """`value` as `_plain` gives it, or a named tuple, whose type the newly made model tells."""
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        return "named", [_plain(item) for item in value]
    return _plain(value)


def _plain(value: Any) -> Any:
    """`value` as lists, dictionaries and tensors; another type that can be had back is ("its name", ...).

    Raises:
        TypeError: it is of any other type, also one derived from these.
    """
    if type(value) in _PLAIN or type(value) is torch.Tensor:
        return value
    if type(value) is np.ndarray:
        return "array", torch.from_numpy(np.array(value, order="C"))
    if isinstance(value, np.generic):
        return "scalar", torch.from_numpy(np.array(value))
    if type(value) is deque:
        return "deque", [_plain(item) for item in value], value.maxlen
    if type(value) is tuple:
        return "tuple", [_plain(item) for item in value]
    if type(value) is list:
        return [_plain(item) for item in value]
    if type(value) is dict and all(type(key) in _PLAIN for key in value):
        return {key: _plain(item) for key, item in value.items()}
    raise TypeError(f"it is a {type(value).__name__}, not numbers, texts and arrays.")


def _restored(value: Any, like: Any = None) -> Any:
    """What `_attribute` was given; `like` has the type of a named tuple."""
    if isinstance(value, list):
        return [_restored(item) for item in value]
    if isinstance(value, dict):
        return {key: _restored(item) for key, item in value.items()}
    if not isinstance(value, tuple):
        return value
    kind, content, *rest = value
    if kind == "array":
        return content.numpy()
    if kind == "scalar":
        return content.numpy()[()]
    items = [_restored(item) for item in content]
    if kind == "deque":
        return deque(items, *rest)
    return type(like)(*items) if kind == "named" else tuple(items)
