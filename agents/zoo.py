"""The table of algorithms: name -> class, policy, hyperparameters. An algorithm is one row."""

import importlib
import inspect
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from gymnasium import spaces

from usbench.agents import plugins
from usbench.agents.hyperparameters import RANGES, Value, check, parse
from usbench.checks import check_seed, unknown


@dataclass(frozen=True)
class Entry:
    """A row of the table. Texts "module:name" stand for what is imported when a model is made."""

    cls: str
    policy: str | None = None
    hyperparameters: Mapping[str, Value] = field(default_factory=dict)
    policy_kwargs: Mapping[str, Any] = field(default_factory=dict)
    kwargs: Mapping[str, Any] = field(default_factory=dict)
    # What `kwargs` hold besides where observations are dictionaries of an image and senses.
    kwargs_with_senses: Mapping[str, Any] = field(default_factory=dict)
    tasks: Mapping[str, Mapping[str, Value]] = field(default_factory=dict)
    presets: Mapping[str, Mapping[str, Value]] = field(default_factory=dict)
    # How many environments in step it learns in, unless a trial says otherwise.
    n_envs: int = 1
    learns: bool = True
    # What a `Setting` makes for it beside the environment, by the name of the method. An agent with a need is
    # told the truth while it learns, and is not ranked.
    needs: str = ""
    # Whether the agent looks at frames; for an agent that does not look, no frames are simulated.
    looks: bool = True
    # Whether it is a row of the paper's grid and of the search; others are made for unseen phantoms.
    compared: bool = True
    # What it is, in a line.
    title: str = ""


# Every network is a trunk and one fully connected output.
TRUNK = {"features_extractor_class": "usbench.agents.networks:ConvTrunk", "net_arch": []}
# Separate trunks, as in VPG: errors of values are tens in size and would drown the policy in a shared trunk.
SEPARATE = {**TRUNK, "share_features_extractor": False}
# For phantoms never seen: averages over a coarse grid.
GRID = {"features_extractor_class": "usbench.agents.value_based.grid_trunk:GridTrunk", "net_arch": []}
# For losses that compare with what the network said while it acted, or with a target network: see `Block`.
RUNNING = {"features_extractor_kwargs": {"batch_statistics": False}}
# The names of Stable-Baselines3's policies for observations that are dictionaries.
MULTI_INPUT = {
    "CnnPolicy": "MultiInputPolicy",
    "MlpPolicy": "MultiInputPolicy",
    "MlpLstmPolicy": "MultiInputLstmPolicy",
}
REPLAY = {"replay_buffer_class": "usbench.agents.frame_buffer:FrameReplayBuffer"}

# What can stand in place of the paper's trunk: see `entry`.
NETWORKS = {"residual": "usbench.agents.residual_trunk:ResidualTrunk"}

TABLE_II: dict[str, Value] = {
    "learning_rate": 1e-4,
    "value_learning_rate": 1e-3,
    "n_steps": 64,
    "gamma": 0.99,
    "gae_lambda": 0.97,
    # From here on the paper leaves the value open.
    "n_value_steps": 3,
    # What the random agent would collect without end, at -1.3 per step: see the class.
    "initial_value": -130.0,
    "adam_beta1": 0.0,
}
# Hyperparameters before the search, which replaces those of its spaces: see `_with_winners`.
UNSEARCHED: dict[str, Entry] = {
    "vpg": Entry(
        title="the paper's vanilla policy gradient, hyperparameters of its Table II",
        cls="usbench.agents.vpg:VPG",
        policy="CnnPolicy",
        hyperparameters=TABLE_II,
        tasks={
            "fp": {"gae_lambda": 0.95},
            "pp": {"gae_lambda": 0.97},
            "fp-random": {"gae_lambda": 0.95},
            # What the random agent would collect without end, at 1.4 per step.
            "setup": {"initial_value": 140.0},
        },
        presets={"spinup": {"n_value_steps": 80}},
    ),
    "vpg-tuned": Entry(
        title="the paper's algorithm, hyperparameters chosen by the search",
        cls="usbench.agents.vpg:VPG",
        policy="CnnPolicy",
        hyperparameters=TABLE_II,
    ),
    "a2c": Entry(
        title="advantage actor-critic (Mnih et al. 2016)",
        cls="usbench.agents.on_policy:A2C",
        policy="MlpPolicy",
        policy_kwargs=SEPARATE,
        hyperparameters={
            "learning_rate": 1e-4,
            "n_steps": 64,
            "gamma": 0.9,
            "gae_lambda": 0.95,
            "ent_coef": 0.01,
            "vf_coef": 0.5,
            "max_grad_norm": 0.5,
            "normalize_advantage": True,
            # SB3's default corrects no bias: RMSprop's first steps are ten times the learning rate.
            "use_rms_prop": False,
        },
    ),
    "ppo": Entry(
        title="proximal policy optimisation (Schulman et al. 2017)",
        cls="usbench.agents.on_policy:PPO",
        policy="MlpPolicy",
        policy_kwargs=SEPARATE | RUNNING,
        hyperparameters={
            "learning_rate": 6e-4,
            "n_steps": 256,
            "batch_size": 128,
            "n_epochs": 6,
            "gamma": 0.9,
            "gae_lambda": 1.0,
            "clip_range": 0.1,
            "ent_coef": 0.025,
            "vf_coef": 0.5,
            "max_grad_norm": 0.5,
            "normalize_advantage": True,
        },
    ),
    "dqn": Entry(
        title="deep Q-network (Mnih et al. 2015)",
        cls="stable_baselines3:DQN",
        policy="MlpPolicy",
        policy_kwargs=TRUNK | RUNNING,
        kwargs=REPLAY,
        hyperparameters={
            "learning_rate": 7e-5,
            # The paper's whole budget: the buffer forgets no step.
            "buffer_size": 16_064,
            "learning_starts": 500,
            "batch_size": 64,
            "gamma": 0.8,
            "train_freq": 8,
            "gradient_steps": 1,
            "target_update_interval": 500,
            "tau": 1.0,
            "exploration_fraction": 0.1,
            "exploration_initial_eps": 1.0,
            "exploration_final_eps": 0.02,
            "max_grad_norm": 10.0,
        },
    ),
    "qrdqn": Entry(
        title="DQN with quantile regression (Dabney et al. 2018)",
        cls="sb3_contrib:QRDQN",
        policy="MlpPolicy",
        policy_kwargs=TRUNK | RUNNING | {"n_quantiles": 50},
        kwargs=REPLAY,
        hyperparameters={
            "learning_rate": 1e-4,
            "buffer_size": 16_064,
            "learning_starts": 500,
            "batch_size": 32,
            "gamma": 0.9,
            "train_freq": 4,
            "gradient_steps": 1,
            "target_update_interval": 500,
            "tau": 1.0,
            "exploration_fraction": 0.3,
            "exploration_initial_eps": 1.0,
            "exploration_final_eps": 0.05,
            "max_grad_norm": 10.0,
        },
    ),
    "trpo": Entry(
        title="trust region policy optimisation (Schulman et al. 2015)",
        cls="usbench.agents.on_policy:TRPO",
        policy="MlpPolicy",
        policy_kwargs=SEPARATE | RUNNING,
        kwargs_with_senses={"rollout_buffer_class": "usbench.agents.dict_rollout:SliceableRolloutBuffer"},
        hyperparameters={
            "learning_rate": 1e-3,
            "n_steps": 256,
            "batch_size": 64,
            "gamma": 0.9,
            "gae_lambda": 0.95,
            "target_kl": 0.01,
            "cg_max_steps": 5,
            "cg_damping": 0.1,
            # The graph of second derivatives of the whole rollout would take gigabytes.
            "sub_sampling_factor": 4,
            "n_critic_updates": 4,
            "normalize_advantage": True,
        },
    ),
    "recurrent_ppo": Entry(
        title="PPO with an LSTM",
        cls="sb3_contrib:RecurrentPPO",
        policy="MlpLstmPolicy",
        policy_kwargs=SEPARATE
        | RUNNING
        | {
            "features_extractor_class": "usbench.agents.networks:ProjectedTrunk",
            "lstm_hidden_size": 64,
        },
        hyperparameters={
            # Ten times that of PPO: a weight has less effect with 64 features than with the trunk's 7040.
            "learning_rate": 1e-3,
            "n_steps": 256,
            "batch_size": 64,
            "n_epochs": 4,
            "gamma": 0.9,
            "gae_lambda": 0.95,
            "clip_range": 0.2,
            "ent_coef": 0.01,
            "vf_coef": 0.5,
            "max_grad_norm": 0.5,
            "normalize_advantage": True,
        },
    ),
    "double_dqn": Entry(
        title="double DQN with n-step returns and exact symmetries (van Hasselt et al. 2016)",
        cls="usbench.agents.value_based.double_dqn:DoubleDQN",
        policy="MlpPolicy",
        policy_kwargs=GRID,
        n_envs=32,
        compared=False,
        hyperparameters={
            "learning_rate": 1e-3,
            "final_learning_rate": 5e-5,
            "buffer_size": 100_000,
            "learning_starts": 1_024,
            "batch_size": 128,
            "gamma": 0.9,
            "return_steps": 3,
            "train_freq": 32,
            "gradient_steps": 2,
            # An average of about the last hundred updates.
            "target_update_interval": 32,
            "tau": 0.02,
            "exploration_fraction": 0.2,
            "exploration_initial_eps": 1.0,
            "exploration_final_eps": 0.05,
            "max_grad_norm": 10.0,
            "max_shift_px": 0,
        },
    ),
    "distilled": Entry(
        title="student of the best policy over beliefs: a ceiling, not ranked (Ross et al. 2011)",
        cls="usbench.agents.taught.distilled:Distilled",
        policy="MlpPolicy",
        policy_kwargs=GRID,
        n_envs=32,
        compared=False,
        needs="teacher",
        hyperparameters={
            "learning_rate": 1e-3,
            "final_learning_rate": 5e-5,
            "buffer_size": 100_000,
            "learning_starts": 1_024,
            "batch_size": 128,
            "temperature": 0.1,
            "train_freq": 32,
            "gradient_steps": 4,
            # An average of about the last two hundred updates.
            "target_update_interval": 32,
            "tau": 0.02,
            # The share of the teacher's steps.
            "exploration_fraction": 0.1,
            "exploration_initial_eps": 1.0,
            "exploration_final_eps": 0.0,
            "max_grad_norm": 10.0,
            "max_shift_px": 0,
        },
    ),
    "ppo_asymmetric": Entry(
        title="PPO whose critic is told the state while it learns (Pinto et al. 2017)",
        cls="usbench.agents.asymmetric.ppo:AsymmetricPPO",
        policy="MlpPolicy",
        policy_kwargs=GRID | {"share_features_extractor": False},
        n_envs=16,
        compared=False,
        hyperparameters={
            "learning_rate": 6e-4,
            # 50 steps of each environment: they divide the 100 000 steps of the tracked tasks.
            "n_steps": 800,
            "batch_size": 200,
            "n_epochs": 6,
            "gamma": 0.9,
            "gae_lambda": 0.95,
            "clip_range": 0.2,
            "ent_coef": 0.01,
            "vf_coef": 0.5,
            "max_grad_norm": 0.5,
            "normalize_advantage": True,
        },
    ),
    "belief": Entry(
        title="classical: a recogniser, a Bayes filter over places and the oracle's votes, not ranked",
        cls="usbench.agents.taught.belief:BeliefAgent",
        policy="MultiInputPolicy",
        policy_kwargs={
            "features_extractor_class": "usbench.agents.taught.belief:LastFrameTrunk",
            "net_arch": [],
        },
        n_envs=32,
        compared=False,
        needs="scene_model",
        hyperparameters={
            "learning_rate": 1e-3,
            "final_learning_rate": 5e-5,
            "buffer_size": 100_000,
            "learning_starts": 1_024,
            "batch_size": 128,
            "train_freq": 32,
            "gradient_steps": 4,
            "target_update_interval": 32,
            "tau": 0.02,
            "exploration_fraction": 0.2,
            "exploration_initial_eps": 1.0,
            "exploration_final_eps": 0.05,
            "max_grad_norm": 10.0,
            "max_shift_px": 0,
        },
    ),
    "random": Entry(
        title="reference policy: every action is equally probable",
        cls="usbench.agents.baselines:Random",
        learns=False,
        looks=False,
    ),
    "stay": Entry(
        title="reference policy: never moves", cls="usbench.agents.baselines:Stay", learns=False, looks=False
    ),
    "oracle": Entry(
        title="reference policy: knows the pose and plays the optimum",
        cls="usbench.agents.baselines:Oracle",
        learns=False,
        looks=False,
    ),
}
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
        ValueError: no algorithm has that name; the message says the closest name.
    """
    if algo in ZOO:
        return ZOO[algo]
    if "+" in algo:
        return _with_network(*algo.rsplit("+", 1))
    registered = plugins.registered()
    place = registered.get(algo, algo)
    if ":" in place:
        found = plugins.load(place)
        return found if isinstance(found, Entry) else _row(place, found)
    raise unknown("algorithm", algo, [*ZOO, *registered])


def _with_network(algo: str, network: str) -> Entry:
    """The row of `algo` with another trunk in place of the paper's."""
    row = entry(algo)
    if network not in NETWORKS:
        raise unknown("network", network, NETWORKS)
    if row.policy is None:
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

    Overrides given as text, as on a command line, are parsed to the declared type.

    Raises:
        TypeError: an override has the wrong type.
        ValueError: an algorithm, preset or hyperparameter is unknown (the message says the closest name), or
            a value is out of range.
    """
    row = entry(algo)
    merged = {**row.hyperparameters, **row.tasks.get(task, {}), **row.presets.get(preset or "", {})}
    for name, value in (overrides or {}).items():
        if name in row.hyperparameters and name in RANGES:
            merged[name] = parse(name, value) if isinstance(value, str) else check(name, value)
        else:
            raise unknown(f"hyperparameter of {algo}", name, sorted(row.hyperparameters.keys() & RANGES))
    if preset is not None and preset not in row.presets:
        raise unknown(f"preset of {algo}", preset, row.presets)
    if merged.get("n_steps", 0) % merged.get("batch_size", 1):
        raise ValueError(
            f"n_steps must be a multiple of batch_size, which {merged['n_steps']} is not "
            f"of {merged['batch_size']}."
        )
    return merged


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
    step stays the same. `kwargs` go to the constructor; a `policy` or `policy_kwargs` among them replaces
    that of the row (the oracle needs a `policy`).

    Raises:
        ValueError: the number of environments does not divide `n_steps`.
    """
    row = entry(algo)
    if isinstance(env.observation_space, spaces.Dict):
        row = _with_senses(row)
    policy = _resolved(kwargs.pop("policy", row.policy))
    fixed = {**({"policy_kwargs": row.policy_kwargs} if row.policy_kwargs else {}), **row.kwargs}
    kwargs = {**{name: _resolved(value) for name, value in fixed.items()}, **kwargs}
    shared = _shared(hyperparameters, getattr(env, "num_envs", 1))
    return model_class(algo)(policy, env, seed=check_seed(seed), **shared, **kwargs)


def _with_senses(row: Entry) -> Entry:
    """The row for observations that are dictionaries of an image and senses: its trunk, and senses beside."""
    if row.policy not in MULTI_INPUT:
        return row
    own = dict(row.policy_kwargs)
    trunk = own.get("features_extractor_class", TRUNK["features_extractor_class"])
    own["features_extractor_class"] = "usbench.agents.sensing_trunk:SensingTrunk"
    own["features_extractor_kwargs"] = {**own.get("features_extractor_kwargs", {}), "trunk": trunk}
    kwargs = {**row.kwargs, **row.kwargs_with_senses}
    return replace(row, policy=MULTI_INPUT[row.policy], policy_kwargs=own, kwargs=kwargs)


def _shared(hyperparameters: Mapping[str, Value], n_envs: int) -> dict[str, Value]:
    """The hyperparameters that Stable-Baselines3 counts per environment, shared out among `n_envs`.

    Updates per step stay as they are: less often, or more at a time.
    """
    shared = dict(hyperparameters)
    if "n_steps" in shared:
        n_steps, rest = divmod(int(shared["n_steps"]), n_envs)
        if rest:
            raise ValueError(f"n_steps must be a multiple of {n_envs} environments, not {shared['n_steps']}.")
        shared["n_steps"] = n_steps
    if "gradient_steps" in shared:
        train_freq = int(shared.get("train_freq", 1))
        common = math.gcd(train_freq, n_envs)
        shared["gradient_steps"] = int(shared["gradient_steps"]) * (n_envs // common)
        shared |= {"train_freq": train_freq // common} if "train_freq" in shared else {}
    return shared


def model_class(algo: str) -> Any:
    """The class of `algo`, imported only when it is asked for, so that reading the table stays fast."""
    return _resolved(entry(algo).cls)


def _resolved(value: Any) -> Any:
    """What the text "module:name" stands for, also inside a mapping; anything else unchanged."""
    if isinstance(value, Mapping):
        return {key: _resolved(inner) for key, inner in value.items()}
    if not isinstance(value, str) or ":" not in value:
        return value
    module, name = value.split(":")
    return getattr(importlib.import_module(module), name)
