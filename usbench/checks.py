"""What a user may pass: numbers, quantities with a unit, and names, checked alike everywhere.

A value comes in, and goes out as a plain Python number; one that is not allowed is refused in one sentence,
with the value and what is allowed. This module imports nothing of the project, so that all of it can use it.
"""

from __future__ import annotations

import contextlib
import difflib
import math
import numbers
import re
import reprlib
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from pydantic import ValidationError

T = TypeVar("T")


class ConfigurationError(ValueError):
    """A setting that cannot be used; the message is one sentence for the user."""


@contextlib.contextmanager
def as_configuration_error() -> Iterator[None]:
    """Raise as ConfigurationError what a value is refused with in the block: a TypeError or a ValueError."""
    try:
        yield
    except (TypeError, ValueError) as error:
        raise ConfigurationError(str(error)) from error


@dataclass(frozen=True)
class Unit:
    """A unit, and those that a value may have been given in by mistake.

    Attributes:
        symbol: Of the unit.
        others: Symbols of other units, the likeliest first, and how many of this unit one of them is.
    """

    symbol: str
    others: Mapping[str, float]


HERTZ = Unit("Hz", MappingProxyType({"MHz": 1e6, "kHz": 1e3}))
METRES = Unit("m", MappingProxyType({"mm": 1e-3, "um": 1e-6}))
METRES_PER_SECOND = Unit("m/s", MappingProxyType({"mm/us": 1e3, "cm/s": 1e-2}))


def number(
    name: str,
    value: Any,
    *,
    low: float = -math.inf,
    high: float = math.inf,
    above: bool = False,
    below: bool = False,
) -> float:
    """Return `value` as a finite float in [low, high]: above `low` where `above`, below `high` where `below`.

    Raises:
        TypeError: If `value` is not a real number; True and "5" are none.
        ValueError: If it is not finite, or outside the interval.
    """
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        raise TypeError(_refused(name, value, interval(low, high, above=above, below=below)))
    try:
        found = float(value)
    except OverflowError:  # of a whole number with hundreds of digits
        found = math.inf
    inside = low <= found <= high and not (above and found == low) and not (below and found == high)
    if not (inside and math.isfinite(found)):
        raise ValueError(_refused(name, value, interval(low, high, above=above, below=below)))
    return found + 0.0  # never -0, which equals 0 and has another text


def positive(name: str, value: Any) -> float:
    """Return `value` as a finite float above 0; errors are those of `number`."""
    return number(name, value, low=0.0, above=True)


def non_negative(name: str, value: Any) -> float:
    """Return `value` as a finite float from 0; errors are those of `number`."""
    return number(name, value, low=0.0)


def quantity(name: str, value: Any, low: float, high: float, unit: Unit) -> float:
    """Return `value` as a float in [low, high].

    Raises:
        TypeError: If `value` is not a real number.
        ValueError: If it lies outside; the message says in which unit it was probably given.
    """
    found = non_negative(name, value)
    if low <= found <= high:
        return found
    allowed = f"a number in [{plain(low)}, {plain(high)}] {unit.symbol}"
    hint = meant(found, low, high, unit)
    raise ValueError(f"{name} must be {allowed}, not {reprlib.repr(value)}{hint or '.'}")


def meant(value: float, low: float, high: float, unit: Unit) -> str:
    """Return the question in which unit `value` was given, "" if no other unit brings it into [low, high]."""
    for symbol, factor in unit.others.items():
        if low <= abs(value) * factor <= high:
            return f": did you mean {plain(value * factor)} ({plain(value)} {symbol})?"
    return ""


def plain(value: float) -> str:
    """Return a number in few characters, as Python reads it: 7e6, 0.00027."""
    return f"{value:g}".replace("e+0", "e").replace("e-0", "e-").replace("e+", "e")


def probability(name: str, value: Any) -> float:
    """Return `value` as a float in [0, 1].

    Raises:
        TypeError: If `value` is not a real number.
        ValueError: If it is outside [0, 1].
    """
    try:
        return number(name, value, low=0.0, high=1.0)
    except (TypeError, ValueError) as error:
        raise type(error)(_refused(name, value, "a probability in [0, 1]")) from None


def whole_number(name: str, value: Any, low: float = -math.inf, high: float = math.inf) -> int:
    """Return `value` as an int in [low, high]; 5, 5.0 and NumPy's integers are whole numbers.

    Raises:
        TypeError: If `value` is not a real number; True and "5" are none.
        ValueError: If it is a number, but not a whole one, or outside the interval.
    """
    if type(value) is int and low <= value <= high:  # by far the most frequent: `numbers.Real` is slow
        return value
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        raise TypeError(_refused(name, value, whole_interval(low, high)))
    found: Any = value
    is_whole = abs(found) < math.inf and found == int(found)  # false for nan
    if not is_whole or not low <= found <= high:
        raise ValueError(_refused(name, value, whole_interval(low, high)))
    return int(found)


def check_type(name: str, value: object, allowed: type[T]) -> T:
    """Return `value`.

    Raises:
        TypeError: If it is not of the type that is allowed.
    """
    if not isinstance(value, allowed):
        raise TypeError(f"{name} must be of type {allowed.__name__}, not {reprlib.repr(value)}.")
    return value


def check_seed(seed: object) -> int:
    """Return `seed` as an int that NumPy and torch take; errors are those of `whole_number`.

    A float is none, even a whole one: in a record it would give the trial another name.
    """
    if isinstance(seed, numbers.Real) and not isinstance(seed, numbers.Integral):
        raise TypeError(_refused("seed", seed, whole_interval(0, 2**32 - 1)))
    return whole_number("seed", seed, 0, 2**32 - 1)


def check_plain_name(what: str, name: str) -> str:
    """Return `name` if a folder may have it anywhere: up to 64 letters, digits, "-" and "_".

    Raises:
        ValueError: If not.
    """
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}", name):
        raise ValueError(f"{what} must be of up to 64 letters, digits, '-' and '_', not {name!r}.")
    return name


def interval(low: float, high: float, *, above: bool = False, below: bool = False) -> str:
    """Return in words which numbers `number` allows."""
    if math.isinf(low) and math.isinf(high):
        return "a finite number"
    if low == 0 and math.isinf(high):
        return "a positive number" if above else "a non-negative number"
    return f"a number in {'(' if above else '['}{low:g}, {high:g}{')' if below else ']'}"


def whole_interval(low: float, high: float) -> str:
    """Return in words which numbers `whole_number` allows."""
    if math.isinf(low) and math.isinf(high):
        return "a whole number"
    return f"a whole number from {low}" if math.isinf(high) else f"a whole number in [{low}, {high}]"


def did_you_mean(name: object, allowed: Collection[str], cutoff: float = 0.5) -> str:
    """Return a hint in brackets at the one of `allowed` that is most like `name`, "" if none is like it."""
    close = difflib.get_close_matches(str(name).lower(), allowed, n=1, cutoff=cutoff)
    return f" (did you mean {close[0]!r}?)" if close else ""


def unknown(what: str, name: object, allowed: Collection[str]) -> ValueError:
    """Return the error for a `name` that is not one of `allowed`; it says a close one, if there is one."""
    listed = ", ".join(map(repr, allowed)) or "none"
    return ValueError(
        f"unknown {what} {reprlib.repr(name)}{did_you_mean(name, allowed)}: allowed are {listed}."
    )


def misfit(error: ValidationError) -> str:
    """Return in words what of a checked file is wrong first: which part is missing, or cannot be."""
    first = error.errors(include_url=False, include_context=False)[0]
    where = ".".join(str(part) for part in first["loc"])
    if first["type"] == "missing":
        return f"it has no {where}"
    if first["type"] == "unexpected_keyword_argument":
        return f"{where} is not known"
    if first["type"] == "value_error":
        return str(first["msg"]).removeprefix("Value error, ")
    return f"its {where} cannot be {first['input']!r:.80} ({first['msg'].lower()})"


def _refused(name: str, value: object, allowed: str) -> str:
    return f"{name} must be {allowed}, not {reprlib.repr(value)}."


def install(extra: str) -> str:
    """Return the command that installs what an extra of the package needs, elsewhere and in a clone."""
    return f"pip install 'usbench[{extra}]' (in a clone: pip install -c constraints.txt -e '.[{extra}]')"
