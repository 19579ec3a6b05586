"""Dataclasses and errors in words, for keys and for people, and how algorithms are called."""

from dataclasses import fields, is_dataclass
from typing import Any

NETWORK = "+"


def with_network(algo: str, network: str) -> str:
    """Return how an algorithm with another network than its own is called: "ppo+residual"."""
    return f"{algo}{NETWORK}{network}"


def network_apart(algo: str) -> tuple[str, str]:
    """Return the name of an algorithm without its network, and the network, "" where it is its own."""
    plain, _, network = algo.partition(NETWORK)
    return plain, network


def in_words(value: Any) -> str:
    """Return a dataclass with those fields alone that differ from their defaults.

    A field that is added later, with a default that changes nothing, leaves the words as they were.
    """
    if not is_dataclass(value):
        return repr(value)
    shown = [field for field in fields(value) if field.repr]
    changed = [field.name for field in shown if getattr(value, field.name) != field.default]
    settings = ", ".join(f"{name}={in_words(getattr(value, name))}" for name in changed)
    return f"{type(value).__name__}({settings})"


def in_one_line(error: BaseException, *, with_type: bool = False) -> str:
    """Return what an error says, its lines joined.

    The name of its type stands in front `with_type`, and of a KeyError, which says the missing key alone. Of
    an error that says nothing, it stands by itself.
    """
    told, kind = " ".join(str(error).split()), type(error).__name__
    if not told:
        return kind
    return f"{kind}: {told}" if with_type or isinstance(error, KeyError) else told
