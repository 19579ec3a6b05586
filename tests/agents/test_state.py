"""What a model holds, as plain data that runs no code when it is read."""

import io
import random
from collections import Counter, defaultdict, deque, namedtuple

import numpy as np
import pytest
import torch
from stable_baselines3 import PPO

from usbench.agents import model_state

Pair = namedtuple("Pair", "first second")
VALUES = {
    "none": None,
    "number": 1.5,
    "large": 2**127 + 1,
    "text": "array",
    "tensor": torch.arange(3.0),
    "array": np.arange(6, dtype=np.uint8).reshape(2, 3)[:, ::-1],
    "unsigned": np.array([2**32 - 1], np.uint32),
    "scalar": np.float32(0.1),
    "truth": np.array([True]),
    "tuple": (1, ("array", [2])),
    "list": [{"r": 1.0, 3: (4,)}, []],
    "deque": deque([{"l": 16}], maxlen=100),
    "named": Pair((torch.zeros(1), torch.ones(1)), ()),
}


def through_a_file(value):
    buffer = io.BytesIO()
    torch.save(value, buffer)
    return torch.load(io.BytesIO(buffer.getvalue()), weights_only=True)


@pytest.mark.parametrize("value", VALUES.values(), ids=VALUES)
def test_plain_data_comes_back_as_it_was(value):
    again = model_state._restored(through_a_file(model_state._attribute(value)), value)
    assert type(again) is type(value) and repr(again) == repr(value)
    if isinstance(value, np.ndarray | np.generic):
        assert again.dtype == value.dtype
    if isinstance(value, deque):
        assert again.maxlen == value.maxlen


@pytest.mark.parametrize(
    "value",
    [
        object(),
        [lambda: 0],
        {"a": {1}},
        np.array([object()]),
        torch.nn.Linear(1, 1),
        random.Random(),
        # What would come back as another type.
        defaultdict(int),
        Counter("a"),
        np.ma.array([1, 2]),
        [Pair(1, 2)],
        {np.int64(1): 2},
    ],
)
def test_anything_else_is_refused(value):
    with pytest.raises(TypeError):
        model_state._attribute(value)


def test_attributes_of_ones_own_are_kept_whatever_their_names():
    one, other = (PPO("MlpPolicy", "CartPole-v1", n_steps=8, batch_size=8) for _ in range(2))
    one.model, one.teacher, one.clip_range_vf = {"visits": [1]}, 2, 0.5
    model_state.put_back(other, through_a_file(model_state.state_of(one)))
    assert (other.model, other.teacher, other.clip_range_vf) == ({"visits": [1]}, 2, 0.5)
