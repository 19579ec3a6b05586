"""The full state for a critic: where the probe is, where the object is, and what lies between them."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from usbench.coordinates import BY_NAME, COORDINATES, POSE

_OWN = tuple(one.name for one in COORDINATES)


def _values(name: str, info: Mapping[str, Any], key: str) -> list[float]:
    """A coordinate in units of its largest magnitude, an angle as sine and cosine; 0 where it is not told."""
    limits = BY_NAME[name].limits
    if limits is None:
        radians = math.radians(info[key]) if key in info else None
        return [0.0, 0.0] if radians is None else [math.sin(radians), math.cos(radians)]
    return [info.get(key, 0.0) / max(map(abs, limits))]


def _difference(name: str, info: Mapping[str, Any]) -> list[float]:
    """By how much the coordinate differs from that of the object, 0 where one of both is not told."""
    target = f"target_{name}"
    known = name in info and target in info
    return _values(name, {"apart": info[name] - info[target]} if known else {}, "apart")


def state(info: Mapping[str, Any]) -> list[float]:
    """The full state that an `info` tells, in numbers of about 1.

    They are the coordinates of the probe and of the object, and their differences, in that order. What a
    task does not have, or where there is but one object, is 0.

    Raises:
        ValueError: the info tells no coordinate.
    """
    if not any(name in info for name in _OWN):
        raise ValueError(
            f"the info of the environment must tell a state, any of {', '.join(_OWN)}, for a critic that "
            f"is told it, not {', '.join(map(repr, info)) or 'nothing'}."
        )
    own = [value for name in _OWN for value in _values(name, info, name)]
    object_ = [value for name in POSE for value in _values(name, info, f"target_{name}")]
    apart = [value for name in POSE for value in _difference(name, info)]
    return own + object_ + apart


def states(infos: Sequence[Mapping[str, Any]]) -> npt.NDArray[np.float32]:
    """The states `(n, SIZE)` of several environments; raises as `state`."""
    return np.array([state(info) for info in infos], np.float32)


# How many numbers a state has.
SIZE = len(state(dict.fromkeys(_OWN, 0)))
