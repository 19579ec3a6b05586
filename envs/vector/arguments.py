"""What a vector environment is called with, checked before anything moves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.vector import AutoresetMode

from usbench.checks import unknown, whole_number


def mode(value: AutoresetMode | str) -> AutoresetMode:
    """Return the autoreset mode of that name, or raise ValueError."""
    try:
        return AutoresetMode(value)
    except ValueError:
        raise unknown("autoreset_mode", value, [one.value for one in AutoresetMode]) from None


def actions(value: npt.ArrayLike, num_envs: int, n_actions: int) -> list[int]:
    """Return an action per environment, from an array (num_envs,) of integers.

    Raises:
        ValueError: If the array has another shape or type, or an action is not in [0, n_actions).
    """
    chosen = np.asarray(value)
    if chosen.shape != (num_envs,) or chosen.dtype.kind not in "iu":
        raise ValueError(f"actions must be {num_envs} whole numbers, not {value!r}.")
    if chosen.min() < 0 or chosen.max() >= n_actions:
        raise ValueError(f"actions must be whole numbers from 0 to {n_actions - 1}, not {value!r}.")
    return [int(action) for action in chosen]


def seeds(value: int | Sequence[int | None] | None, num_envs: int) -> list[int | None]:
    """Return a seed per environment (of a single number: this and those after it), or raise an error.

    Raises:
        TypeError: If a seed is no number.
        ValueError: If a seed is negative or not whole, or there are not as many as environments.
    """
    if value is None:
        return [None] * num_envs
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value.item()
    if isinstance(value, str) or not isinstance(value, Sequence | np.ndarray):
        first = whole_number("seed", value, low=0)
        return [first + i for i in range(num_envs)]
    if len(value) != num_envs:
        raise ValueError(f"seed must be one number, or {num_envs}, not {len(value)}.")
    return [None if one is None else whole_number("seed", one, low=0) for one in value]


def mask(value: Any, num_envs: int) -> npt.NDArray[np.bool_]:
    """Return the mask of a reset, (num_envs,) bool: which environments are reset.

    Raises:
        ValueError: If it is no such array, or none is reset.
    """
    shape = (num_envs,)
    if (
        not isinstance(value, np.ndarray)
        or value.dtype != np.bool_
        or value.shape != shape
        or not value.any()
    ):
        raise ValueError(
            f"options['reset_mask'] must be a bool array of shape {shape} with a True in it, not {value!r}."
        )
    return value
