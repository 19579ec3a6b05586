"""Phantom, probe and imaging: as plain values into the records of a trial, and back."""

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import Any, TypeVar

T = TypeVar("T")
# Fields that are younger than trials which are kept: records leave them out where they change nothing, so
# that a trial has the name that it always had.
LATER = {
    "attenuation_db_per_cm_mhz": 0.0,
    "slice_thickness": 10e-3,
    "noise_db": None,
    "tgc_db_per_cm": 0.0,
    "receive_focus": None,
    "receive_f_number": None,
    "count": None,
}


def plain(part: Any) -> dict[str, Any]:
    """Return a part of the scene, which is a dataclass, as the plain values that JSON gives back."""
    values = json.loads(json.dumps(asdict(part)))
    return {name: value for name, value in values.items() if name not in LATER or value != LATER[name]}


def recorded(cls: Callable[..., T], environment: Mapping[str, Any], name: str) -> T:
    """Return a part of the scene as a trial has recorded it, its default where nothing is recorded.

    Raises:
        TypeError: If what is recorded has other names than the part.
        ValueError: If a value is not allowed.
    """
    return cls(**environment.get(name, {}))
