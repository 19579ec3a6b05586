"""What `trial.json` may hold, checked when it is read: it may be damaged, or a stranger's."""

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

Check = Callable[[Any], bool]


def _text(value: Any) -> bool:
    return isinstance(value, str)


def _number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _whole(value: Any) -> bool:
    return type(value) is int and 0 <= value < 2**53


def _mapping_of(check: Check) -> Check:
    return lambda value: isinstance(value, dict) and all(map(check, value.values()))


ANYTHING = _mapping_of(lambda _: True)
TEXTS = _mapping_of(_text)
# What a trial that has begun always records; further keys may hold anything.
CONFIG: Mapping[str, Check] = {
    "task": _text,
    "algo": _text,
    "noise": lambda value: _number(value) and 0 <= value <= 1,
    "seed": lambda value: _whole(value) and value < 2**32,
    "steps": _whole,
    "hyperparameters": ANYTHING,
    "environment": ANYTHING,
}
ANCHORS: Mapping[str, Check] = {"optimal": _number, "random": _number, "stay": _number}
STATE: Mapping[str, Check] = {
    "status": lambda value: value in ("running", "interrupted", "failed", "finished"),
    "config": lambda value: ANYTHING(value) and not _misfit(value, CONFIG),
    "anchors": lambda value: ANYTHING(value) and not _misfit(value, ANCHORS),
}
# What may be missing.
OPTIONAL: Mapping[str, Check] = {
    "reason": lambda value: value is None or _text(value),
    "timings": _mapping_of(_number),
    "versions": TEXTS,
    "frames": lambda value: ANYTHING(value) and _text(value.get("digest")),
    # Names of files: none that leads elsewhere.
    "checksums": lambda value: TEXTS(value) and value.keys() <= {"episodes.jsonl", "evaluations.jsonl"},
    "references": _mapping_of(_mapping_of(_number)),
    "checkpoints": lambda value: isinstance(value, list) and all(map(_whole, value)),
    "evaluation_episodes": _whole,
    "platform": _text,
    "started": _text,
}


def check(path: Path, state: Mapping[str, Any]) -> None:
    """Check a state read from `path`; an empty one is that of a trial killed in its first moment.

    Raises:
        ValueError: If something is missing or of another kind; one sentence says what.
    """
    later = {name: own for name, own in OPTIONAL.items() if name in state}
    misfit = _misfit(state, {**STATE, **later}) if "config" in state else ""
    if misfit:
        for part, checks in (("config", CONFIG), ("anchors", ANCHORS)):
            if misfit == part and isinstance(state.get(part), dict):
                misfit = f"{_misfit(state[part], checks)} in {part}"
        raise ValueError(f"{path} is not a trial record: it has no {misfit}, or one that cannot be.")


def _misfit(values: Mapping[str, Any], checks: Mapping[str, Check]) -> str:
    """Return the first name whose value is missing or not as it should be, "" if there is none."""
    return next((name for name, fits in checks.items() if name not in values or not fits(values[name])), "")
