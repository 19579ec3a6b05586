"""Every algorithm of the table that learns, on small images: the same trunk, exact repeats, fair updates."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from signs import Signs
from stable_baselines3.common.vec_env import DummyVecEnv

from usbench.agents import zoo
from usbench.agents.networks import ConvTrunk

LEARNERS = [algo for algo, row in zoo.ZOO.items() if row.learns and not row.needs]
# An update or more within 64 steps.
SMALL = {
    "vpg": {"n_steps": 16},
    "vpg-tuned": {"n_steps": 16},
    "a2c": {"n_steps": 16},
    "ppo": {"n_steps": 32, "batch_size": 16, "n_epochs": 2},
    "dqn": {"learning_starts": 16, "target_update_interval": 16, "train_freq": 4},
    "double_dqn": {"learning_starts": 16, "train_freq": 4, "batch_size": 16},
    "ppo_asymmetric": {"n_steps": 32, "batch_size": 16, "n_epochs": 2},
    "qrdqn": {"learning_starts": 16, "target_update_interval": 16},
    "trpo": {"n_steps": 32, "batch_size": 16, "sub_sampling_factor": 2},
    "recurrent_ppo": {"n_steps": 32, "batch_size": 16, "n_epochs": 2},
}
# Steps per update of the settings above, and the updates that each makes then.
UPDATES = {
    "vpg": (16, 1),
    "vpg-tuned": (16, 1),
    "a2c": (16, 1),
    "ppo": (32, 2),
    "dqn": (4, 1),
    "double_dqn": (4, 2),
    "ppo_asymmetric": (32, 2),
    "qrdqn": (4, 1),
    "trpo": (32, 1),
    "recurrent_ppo": (32, 2),
}


def make(algo: str, n_envs: int = 1, seed: int = 3, **overrides: Any) -> Any:
    env = DummyVecEnv([Signs] * n_envs)
    return zoo.make(
        algo, env, seed, zoo.hyperparameters(algo, "pp", SMALL[algo] | overrides), device="cpu", verbose=0
    )


def weights(model: Any) -> torch.Tensor:
    return torch.cat([tensor.double().flatten() for tensor in model.policy.state_dict().values()])


def images(n: int = 40) -> np.ndarray:
    return np.random.default_rng(0).uniform(-3, 3, (n, 8, 8, 1)).astype(np.float32)


def trunks(module: torch.nn.Module) -> list[ConvTrunk]:
    return [part for part in module.modules() if isinstance(part, ConvTrunk)]


@pytest.mark.parametrize("algo", LEARNERS)
def test_learns_on_the_same_trunk_in_exactly_the_steps(algo: str) -> None:
    model = make(algo)
    before = weights(model)
    # Rows that are no part of the comparison may have another.
    assert trunks(model.policy) or not zoo.entry(algo).compared
    assert model.learn(64) is model
    assert model.num_timesteps == 64
    assert torch.isfinite(weights(model)).all() and not torch.equal(weights(model), before)
    assert all(int(trunk.blocks[0][1].num_batches_tracked) for trunk in trunks(model.policy)[:1])


@pytest.mark.parametrize("algo", LEARNERS)
def test_same_seed_gives_the_same_bits(algo: str) -> None:
    first, second, other = (weights(make(algo, seed=seed).learn(64)) for seed in (3, 3, 4))
    assert torch.equal(first, second) and not torch.equal(first, other)


@pytest.mark.parametrize("algo", LEARNERS)
def test_loaded_model_acts_as_the_saved_one(algo: str, tmp_path: Path) -> None:
    model = make(algo).learn(64)
    model.save(tmp_path / "model.zip")
    loaded = zoo.model_class(algo).load(tmp_path / "model.zip", device="cpu")
    for one in (False, True):
        torch.manual_seed(0)
        np.random.seed(0)
        model.action_space.seed(0)
        saved, _ = model.predict(images(), deterministic=one)
        torch.manual_seed(0)
        np.random.seed(0)
        loaded.action_space.seed(0)
        np.testing.assert_array_equal(loaded.predict(images(), deterministic=one)[0], saved)
    assert torch.equal(weights(loaded), weights(model))


@pytest.mark.parametrize("n_envs", [1, 2])
@pytest.mark.parametrize("algo", LEARNERS)
def test_updates_per_step_do_not_depend_on_the_number_of_environments(algo: str, n_envs: int) -> None:
    per, updates = UPDATES[algo]
    model = make(algo, n_envs).learn(64)
    begin = model._n_updates
    model.learn(64, reset_num_timesteps=False)
    assert model.num_timesteps == 128
    assert model._n_updates - begin == 64 // per * updates


@pytest.mark.parametrize("algo", ["vpg", "ppo"])
def test_refuses_environments_that_do_not_divide_the_rollout(algo: str) -> None:
    with pytest.raises(ValueError, match="n_steps must be a multiple of 3 environments, not"):
        make(algo, 3)


def test_ratio_of_ppo_begins_at_one() -> None:
    # The losses see the policy that acted, in spite of batch norm: Schulman et al. (2017), Eq. 6.
    model = make("ppo").learn(64)
    model.collect_rollouts(model.env, model._init_callback(None), model.rollout_buffer, model.n_steps)
    model.policy.set_training_mode(True)
    for batch in model.rollout_buffer.get(16):
        _, log_prob, _ = model.policy.evaluate_actions(batch.observations, batch.actions.long().flatten())
        torch.testing.assert_close(log_prob, batch.old_log_prob, rtol=1e-4, atol=1e-5)
