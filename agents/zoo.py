"""The table of algorithms: name -> class, policy, hyperparameters. An algorithm is one row."""

import importlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from usbench.agents.hyperparameters import RANGES, Value, check, check_seed, parse, unknown


@dataclass(frozen=True)
class Entry:
    """A row of the table. Texts "module:name" stand for what is imported when a model is made."""

    cls: str
    policy: str | None = None
    hyperparameters: Mapping[str, Value] = field(default_factory=dict)
    policy_kwargs: Mapping[str, Any] = field(default_factory=dict)
    tasks: Mapping[str, Mapping[str, Value]] = field(default_factory=dict)
    presets: Mapping[str, Mapping[str, Value]] = field(default_factory=dict)
    learns: bool = True


ZOO: dict[str, Entry] = {
    "vpg": Entry(
        cls="usbench.agents.vpg:VPG",
        policy="CnnPolicy",
        hyperparameters={
            "learning_rate": 1e-4,
            "value_learning_rate": 1e-3,
            "n_steps": 64,
            "gamma": 0.99,
            "gae_lambda": 0.97,
            "n_value_steps": 3,
            # A random hand's -1.3 per step, for ever: see the class.
            "initial_value": -130.0,
            "adam_beta1": 0.0,
        },
        tasks={"fp": {"gae_lambda": 0.95}, "pp": {"gae_lambda": 0.97}},
        presets={"spinup": {"n_value_steps": 80}},
    ),
    "random": Entry(cls="usbench.agents.baselines:Random", learns=False),
    "stay": Entry(cls="usbench.agents.baselines:Stay", learns=False),
    "oracle": Entry(cls="usbench.agents.baselines:Oracle", learns=False),
}


def entry(algo: str) -> Entry:
    """The row of `algo`.

    Raises:
        ValueError: there is none; the message says the closest name.
    """
    if algo not in ZOO:
        raise unknown("algorithm", algo, ZOO)
    return ZOO[algo]


def hyperparameters(
    algo: str, task: str, overrides: Mapping[str, object] | None = None, preset: str | None = None
) -> dict[str, Value]:
    """All hyperparameters of `algo`: the row's, then the task's, the preset's, and `overrides`, checked.

    Overrides given as text, as on a command line, are parsed to the declared type.

    Raises:
        TypeError: an override has the wrong type.
        ValueError: unknown algorithm, preset or hyperparameter (says the closest), or a value out of range.
    """
    row = entry(algo)
    if preset is not None and preset not in row.presets:
        raise unknown(f"preset of {algo}", preset, row.presets)
    merged = {**row.hyperparameters, **row.tasks.get(task, {}), **(row.presets[preset] if preset else {})}
    for name, value in (overrides or {}).items():
        if name not in row.hyperparameters or name not in RANGES:
            raise unknown(f"hyperparameter of {algo}", name, row.hyperparameters)
        merged[name] = parse(name, value) if isinstance(value, str) else check(name, value)
    return merged


def make(algo: str, env: Any, seed: int, hyperparameters: Mapping[str, Value], **kwargs: Any) -> Any:
    """The model of `algo` on `env`: has SB3's `learn`, `predict`, `save` and `load`.

    `kwargs` go to its constructor; `policy` and `policy_kwargs` there replace the row's (the oracle needs its
    `policy`).
    """
    row = entry(algo)
    policy = _resolved(kwargs.pop("policy", row.policy))
    if row.policy_kwargs:
        kwargs.setdefault(
            "policy_kwargs", {key: _resolved(value) for key, value in row.policy_kwargs.items()}
        )
    return model_class(algo)(policy, env, seed=check_seed(seed), **hyperparameters, **kwargs)


def model_class(algo: str) -> Any:
    """The class of `algo`, imported now: so that listing the table stays fast."""
    return _resolved(entry(algo).cls)


def _resolved(value: Any) -> Any:
    """What the text "module:name" stands for; anything else unchanged."""
    if not isinstance(value, str) or ":" not in value:
        return value
    module, name = value.split(":")
    return getattr(importlib.import_module(module), name)
