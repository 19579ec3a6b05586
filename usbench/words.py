"""A frozen dataclass in words, for keys and for people."""

from dataclasses import fields, is_dataclass
from typing import Any


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
