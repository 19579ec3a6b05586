"""Distributions of phantoms: where objects lie and how they look, and what training never meets."""

from __future__ import annotations

import hashlib
import json
import reprlib
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from functools import cache
from itertools import product
from typing import Any

import numpy as np

from usbench.checks import positive, whole_number
from usbench.envs.phantom import ObjectOfInterest, Phantom

# Phantoms with seeds from here on are for evaluation; training draws its own below, so the two never meet.
FIRST_HELD_OUT = 2**31
LAST = 2**32 - 1
# Phantoms that are drawn for the digest of a set: 0.15 s.
DIGESTED = 256


def phantom_number(value: Any) -> int:
    """Return `value` as the number of a phantom, or raise TypeError or ValueError."""
    return whole_number("phantom", value, 0, LAST)


@dataclass(frozen=True)
class PhantomDistribution:
    """Where the object lies and how it looks: each value drawn evenly, contrast evenly in its logarithm.

    Attributes:
        x_mm: Lateral positions, whole mm.
        depth_mm: Depths of the body's centre, whole mm.
        angle_deg: Rotations of the object's plane, whole degrees.
        scale: Least and largest size relative to the paper's object.
        contrast: Least and largest standard deviation of the object's amplitudes relative to the tissue's.
        count: How many phantoms there are in training, those with the numbers 0 to count - 1; None for all
            below 2**31. Those of the evaluation are never among them.

    Raises:
        TypeError: If a value is no sequence, or one in it or `count` is not a number.
        ValueError: If there is no position, depth or angle, or one is not whole, `scale` or `contrast` are
            not two positive numbers, the least first, an object would not lie inside of the phantom, or
            `count` is less than 1 or larger than the numbers there are.
    """

    x_mm: tuple[int, ...]
    depth_mm: tuple[int, ...]
    angle_deg: tuple[int, ...]
    scale: tuple[float, float] = (0.7, 1.1)
    contrast: tuple[float, float] = (5.0, 20.0)
    count: int | None = None

    def __post_init__(self) -> None:
        """Hold the values as tuples of plain numbers and the count as a whole number, or refuse them."""
        for name in ("x_mm", "depth_mm", "angle_deg"):
            object.__setattr__(self, name, _places(name, getattr(self, name)))
        for name in ("scale", "contrast"):
            object.__setattr__(self, name, _span(name, getattr(self, name)))
        if self.count is not None:
            object.__setattr__(
                self, "count", whole_number("the number of phantoms", self.count, 1, FIRST_HELD_OUT)
            )
        # Where the largest objects at the ends lie inside, all do.
        ends = [(min(values), max(values)) for values in (self.x_mm, self.depth_mm)]
        for x_mm, depth_mm, angle_deg in product(*ends, self.angle_deg):
            Phantom(object_of_interest=ObjectOfInterest(x_mm, depth_mm, angle_deg, scale=self.scale[1]))

    @property
    def digest(self) -> str:
        """What names the fixed set of training phantoms, 16 hexadecimal digits; "" where there is none.

        Two sets have the same digest if the distribution, the count and the phantoms' numbers and objects
        are the same; of more than 256 phantoms, the first 256 stand for all.
        """
        return "" if self.count is None else _digest(self)

    def training_number(self, rng: np.random.Generator) -> int:
        """Return the number of a training phantom; one number is drawn, however many phantoms there are."""
        number = int(rng.integers(FIRST_HELD_OUT))
        return number if self.count is None else number % self.count

    def phantom(self, seed: int) -> Phantom:
        """Return the phantom of `seed`, from which all of it follows: object, place and speckle."""
        # Another stream than that of the speckle, which the seed alone begins.
        rng = np.random.default_rng([seed, 1])
        x_mm, depth_mm, angle_deg = (
            int(rng.choice(values)) for values in (self.x_mm, self.depth_mm, self.angle_deg)
        )
        scale = float(rng.uniform(*self.scale))
        contrast = float(np.exp(rng.uniform(*np.log(self.contrast))))
        return Phantom(
            seed=seed,
            object_of_interest=ObjectOfInterest(x_mm, depth_mm, angle_deg, scale=scale, contrast=contrast),
        )


def _places(name: str, values: Any) -> tuple[int, ...]:
    """Return `values` as whole numbers, one at least, or raise TypeError or ValueError."""
    found = tuple(whole_number(name, value) for value in _sequence(name, values))
    if not found:
        raise ValueError(f"{name} must be at least one whole number, not {reprlib.repr(values)}.")
    return found


def _span(name: str, values: Any) -> tuple[float, float]:
    """Return `values` as least and largest positive number, or raise TypeError or ValueError."""
    found = tuple(positive(name, value) for value in _sequence(name, values))
    if len(found) != 2 or found[0] > found[1]:
        raise ValueError(f"{name} must be two numbers, the least first, not {reprlib.repr(values)}.")
    return found


def _sequence(name: str, values: Any) -> Iterable[Any]:
    if isinstance(values, str) or not isinstance(values, Iterable):
        raise TypeError(f"{name} must be a sequence of numbers, not {reprlib.repr(values)}.")
    return values


@cache
def _digest(distribution: PhantomDistribution) -> str:
    assert distribution.count is not None
    drawn = [distribution.phantom(number) for number in range(min(distribution.count, DIGESTED))]
    text = json.dumps([asdict(distribution), [_told(phantom) for phantom in drawn]], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _told(phantom: Phantom) -> list[Any]:
    """Return number and object of a phantom; processors differ in the last digit of the contrast."""
    own = phantom.object_of_interest
    return [phantom.seed, asdict(own) | {"contrast": float(f"{own.contrast:.12g}")}]
