"""What a model holds, as plain data that runs no code when it is read."""

import io
import random
from collections import deque, namedtuple

import numpy as np
import pytest
import torch

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
    again = model_state._restored(through_a_file(model_state._plain(value)), value)
    assert type(again) is type(value) and repr(again) == repr(value)
    if isinstance(value, np.ndarray | np.generic):
        assert again.dtype == value.dtype
    if isinstance(value, deque):
        assert again.maxlen == value.maxlen


@pytest.mark.parametrize(
    "value", [object(), [lambda: 0], {"a": {1}}, np.array([object()]), torch.nn.Linear(1, 1), random.Random()]
)
def test_anything_else_is_refused(value):
    with pytest.raises(TypeError):
        model_state._plain(value)
