"""The table of algorithms: name -> class, policy, hyperparameters. An algorithm is one row."""

import inspect
import json
import math
import pkgutil
import warnings
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from gymnasium import spaces

from usbench.agents import adapting, plugins
from usbench.agents.hyperparameters import RANGES, Value, check, parse
from usbench.agents.rows.compared import COMPARED
from usbench.agents.rows.entry import REPLAY, RUNNING, SEPARATE, TRUNK, Entry
from usbench.agents.rows.reference import REFERENCE
from usbench.agents.rows.unseen import UNSEEN
from usbench.checks import check_seed, unknown
from usbench.words import network_apart

__all__ = [
    "TRUNK",
    "UNSEARCHED",
    "WINNERS",
    "ZOO",
    "Entry",
    "entry",
    "hyperparameters",
    "make",
    "model_class",
    "own_defaults",
    "rollout_steps",
    "usual_envs",
    "winners",
]

# What can stand in place of the paper's trunk: see `entry`.
NETWORKS = {"residual": "usbench.agents.residual_trunk:ResidualTrunk"}

# Hyperparameters before the search, which replaces those of its spaces: see `_with_winners`.
UNSEARCHED: dict[str, Entry] = {**COMPARED, **UNSEEN, **REFERENCE}
# Written by the search, row by row: name -> {"hyperparameters": ..., "protocol": digest of the protocol}.
WINNERS = Path(__file__).with_name("winners.json")


def winners() -> dict[str, dict[str, Any]]:
    """Return what the search has chosen so far, by row; the rows that are not searched yet are missing."""
    found: dict[str, dict[str, Any]] = json.loads(WINNERS.read_text(encoding="utf-8"))
    return found


def _with_winners(rows: Mapping[str, Entry]) -> dict[str, Entry]:
    """The rows with the hyperparameters that the search has chosen, for all tasks alike."""
    chosen = {name: winner["hyperparameters"] for name, winner in winners().items()}
    return {
        name: replace(row, hyperparameters={**row.hyperparameters, **chosen.get(name, {})})
        for name, row in rows.items()
    }


ZOO: dict[str, Entry] = _with_winners(UNSEARCHED)


def entry(algo: str) -> Entry:
    """The row of `algo`: from the table, from an entry point, or made for the class at "module:name".

    "name+network" is the row `name` with another network of `NETWORKS`.

    Raises:
        TypeError: what stands at "module:name" is neither an `Entry` nor a class with `learn` and `predict`.
        ValueError: no algorithm has that name (the message says the closest name), or the algorithm has no
            network that the other one could replace.
    """
    if not isinstance(algo, str):
        raise unknown("algorithm", algo, ZOO)
    if algo in ZOO:
        return ZOO[algo]
    plain, network = network_apart(algo)
    if network:
        return _with_network(plain, network)
    registered = plugins.registered(ZOO)
    place = registered.get(algo, algo)
    if ":" in place or "/" in place or place.endswith(".py"):
        found = plugins.load(place)
        if not isinstance(found, Entry):
            return _row(place, found)
        plugins.load(found.cls)
        return found
    raise unknown("algorithm", algo, [*ZOO, *registered])


def is_of_the_package(algo: str) -> bool:
    """Return whether `algo` is a row of the table, with its own network or another one."""
    return network_apart(algo)[0] in ZOO


def _with_network(algo: str, network: str) -> Entry:
    """The row of `algo` with another trunk in place of the paper's."""
    row = entry(algo)
    if network not in NETWORKS:
        raise unknown("network", network, NETWORKS)
    # Where the policy is that for dictionaries, the row has a trunk for its own observations.
    if row.policy is None or row.policy in adapting.MULTI_INPUT.values():
        raise ValueError(f"{algo} has no network that {network!r} could replace.")
    kept = {name: value for name, value in row.policy_kwargs.items() if name != "features_extractor_kwargs"}
    return replace(row, policy_kwargs=kept | {"features_extractor_class": NETWORKS[network], "net_arch": []})


def _row(place: str, found: Any) -> Entry:
    """The row of a class without one: an algorithm of Stable-Baselines3 gets the network of all others."""
    from stable_baselines3.common.base_class import BaseAlgorithm
    from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
    from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm

    if not isinstance(found, type) or not all(
        callable(getattr(found, x, None)) for x in ("learn", "predict")
    ):
        raise TypeError(f"{place} must be a class with learn and predict, or a zoo.Entry, not {found!r}.")
    if not issubclass(found, BaseAlgorithm):
        return Entry(cls=place)
    network = SEPARATE if issubclass(found, OnPolicyAlgorithm) else TRUNK
    # Stable-Baselines3's own replay buffer would take 54 GB for a million steps.
    replay = REPLAY if issubclass(found, OffPolicyAlgorithm) else {}
    return Entry(cls=place, policy="MlpPolicy", policy_kwargs=network | RUNNING, kwargs=replay)


def hyperparameters(
    algo: str, task: str, overrides: Mapping[str, object] | None = None, preset: str | None = None
) -> dict[str, Value]:
    """All hyperparameters of `algo`: the row's, then the task's, the preset's, and `overrides`, checked.

    Overrides given as text, as on a command line, are parsed to the declared type. A hyperparameter without
    a declared type, as a row of one's own may have, is taken only with a value that the row says. Options
    are left out where they have their default.

    Raises:
        TypeError: an override has the wrong type.
        ValueError: an algorithm, preset or hyperparameter is unknown (the message says the closest name), or
            a value is out of range.
    """
    row = entry(algo)
    merged = {**row.hyperparameters, **row.tasks.get(task, {}), **row.presets.get(preset or "", {})}
    typed = {**row.hyperparameters, **row.options}.keys() & RANGES
    for name, value in (overrides or {}).items():
        if name in typed:
            merged[name] = parse(name, value) if isinstance(value, str) else check(name, value)
        elif name not in RANGES and value in (said := _said(row, task, name)):
            merged[name] = said[said.index(value)]
        else:
            raise unknown(f"hyperparameter of {algo}", name, sorted(typed))
    for name, value in merged.items():
        if name in RANGES and not callable(value):  # as a schedule in a row of one's own
            check(name, value)
    if preset is not None and preset not in row.presets:
        raise unknown(f"preset of {algo}", preset, row.presets)
    if rollout_steps(algo, merged) % int(merged.get("batch_size", 1)):
        raise ValueError(
            f"n_steps must be a multiple of batch_size, which {merged['n_steps']} is not "
            f"of {merged['batch_size']}."
        )
    return {name: value for name, value in merged.items() if row.options.get(name) != value}


def _said(row: Entry, task: str, name: str) -> list[Value]:
    """The values of the hyperparameter `name` in a row, by itself, for the task, and in presets."""
    places = (row.hyperparameters, row.tasks.get(task, {}), *row.presets.values())
    return [place[name] for place in places if name in place]


def rollout_steps(algo: str, hyperparameters: Mapping[str, Value]) -> int:
    """The steps of a rollout, of all environments, 0 where no hyperparameter says it.

    The `n_steps` of an off-policy algorithm are those of its returns.
    """
    n_steps = int(hyperparameters.get("n_steps", 0))
    if not n_steps or algo in ZOO:
        return n_steps
    from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm

    return 0 if issubclass(model_class(algo), OffPolicyAlgorithm) else n_steps


def usual_envs(row: Entry, steps: int, rollout: int) -> int:
    """How many environments learn in step where nobody says it: of the row's number, so many as can.

    They share the `steps` of a trial and those of a `rollout` (0 for none) evenly, and each of them takes two
    steps of a rollout or more. An agent that is not Stable-Baselines3's, without a policy, has one.
    """
    if row.policy is None:
        return 1
    common = math.gcd(row.n_envs, steps, rollout)
    if common > 1 and common == rollout:
        return max(n for n in range(1, common) if common % n == 0)
    return common


def own_defaults(algo: str) -> dict[str, int]:
    """When the class of an algorithm of another module begins to learn, as far as its signature tells.

    Returns:
        The defaults of `n_steps` of an on-policy class, of `learning_starts` of an off-policy class; nothing
        for a row of the table, whose hyperparameters tell, and for any other class.
    """
    row = entry(algo)
    if algo in ZOO or row.hyperparameters or row.policy is None:
        return {}
    from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm

    found = model_class(algo)
    name = "n_steps" if issubclass(found, OnPolicyAlgorithm) else "learning_starts"
    # The signature of a subclass may pass everything on.
    for cls in found.__mro__:
        parameter = inspect.signature(cls.__init__).parameters.get(name)
        if parameter is not None and isinstance(parameter.default, int):
            return {name: parameter.default}
    return {}


def make(algo: str, env: Any, seed: int, hyperparameters: Mapping[str, Value], **kwargs: Any) -> Any:
    """The model of `algo` on `env`: has SB3's `learn`, `predict`, `save` and `load`.

    On a vector of environments an update still takes `n_steps` steps in all, and the number of updates per
    step stays the same, where `hyperparameters` say them: a class without any counts the steps of each
    environment, as Stable-Baselines3 does. `kwargs` go to the constructor; a `policy` or `policy_kwargs`
    among them replaces that of the row (the oracle needs a `policy`).

    Raises:
        ValueError: the number of environments does not divide `n_steps`.
    """
    row = entry(algo)
    if isinstance(env.observation_space, spaces.Dict):
        row = adapting.with_senses(row)
    policy = _resolved(kwargs.pop("policy", row.policy))
    fixed = {**({"policy_kwargs": row.policy_kwargs} if row.policy_kwargs else {}), **row.kwargs}
    kwargs = {**{name: _resolved(value) for name, value in fixed.items()}, **kwargs}
    rollout = rollout_steps(algo, hyperparameters)
    shared = adapting.shared_out(hyperparameters, rollout, getattr(env, "num_envs", 1))
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".n_steps=.* is ignored", UserWarning)  # see `with_n_steps`
        model = model_class(algo)(policy, env, seed=check_seed(seed), **shared, **kwargs)
    return adapting.with_n_steps(model)


def model_class(algo: str) -> Any:
    """The class of `algo`, imported only when it is asked for, so that reading the table stays fast."""
    return _resolved(entry(algo).cls)


def modules(algo: str) -> list[str]:
    """The modules with the code of `algo`: of its class and, from another package, of its row and network."""
    found = {model_class(algo).__module__}
    if not is_of_the_package(algo):
        plain, _ = network_apart(algo)
        said = (plugins.registered(ZOO).get(plain, plain), *entry(algo).policy_kwargs.values())
        found |= {one.__module__ for one in said if isinstance(one, type)}
        found |= {one.partition(":")[0] for one in said if isinstance(one, str) and ":" in one}
    return sorted(found)


def _resolved(value: Any) -> Any:
    """What the text "module:name" stands for, also inside a mapping; anything else unchanged."""
    if isinstance(value, Mapping):
        return {key: _resolved(inner) for key, inner in value.items()}
    if not isinstance(value, str) or ":" not in value:
        return value
    return pkgutil.resolve_name(value)
