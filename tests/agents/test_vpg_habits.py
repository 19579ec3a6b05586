"""The habits of an SB3 algorithm: policies, seeds, files, schedules, callbacks, and what is refused."""

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from signs import Signs, flat
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import CallbackList, CheckpointCallback
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.logger import KVWriter, Logger

from usbench.agents.policies import ConvPolicy
from usbench.agents.vpg import VPG


class Record(KVWriter):
    """Keeps what is logged."""

    def __init__(self) -> None:
        self.rows: list[dict[str, Any]] = []

    def write(self, key_values: dict[str, Any], key_excluded: dict[str, Any], step: int = 0) -> None:
        self.rows.append(dict(key_values))


def test_mlp_policy_and_several_environments() -> None:
    model = VPG("MlpPolicy", make_vec_env("CartPole-v1", 3, seed=0), learning_rate=1e-2, n_steps=128, seed=0)
    model.learn(128 * 3 * 10)
    lengths = [episode["l"] for episode in model.ep_info_buffer]
    assert np.mean(lengths[-20:]) > 45  # random play lasts 22 steps


def test_continuous_actions() -> None:
    model = VPG("MlpPolicy", "Pendulum-v1", seed=0)
    assert model.policy.log_std in set(model.policy.policy_parameters())
    before = model.policy.log_std.item()
    model.learn(64)
    assert model.policy.log_std.item() != before


def test_same_seed_same_bits() -> None:
    models = [VPG("CnnPolicy", Signs(), n_steps=16, seed=seed).learn(48) for seed in (1, 1, 2)]
    assert torch.equal(flat(models[0]), flat(models[1]))
    assert not torch.equal(flat(models[0]), flat(models[2]))


def betas(model: VPG) -> list[tuple[float, float]]:
    return [
        optimizer.param_groups[0]["betas"]
        for optimizer in (model.policy.optimizer, model.policy.value_optimizer)
    ]


def test_no_momentum_is_vpgs_choice_alone() -> None:
    model = VPG("CnnPolicy", Signs(), seed=0)
    assert betas(model) == [(0.0, 0.999)] * 2
    assert model.policy.optimizer.param_groups[0]["eps"] == 1e-5
    asked = VPG("CnnPolicy", Signs(), policy_kwargs={"optimizer_kwargs": {"betas": (0.8, 0.9)}})
    assert betas(asked) == [(0.8, 0.9)] * 2
    other = PPO(ConvPolicy, Signs(), n_steps=16, batch_size=16, device="cpu").learn(16)
    (group,) = other.policy.optimizer.param_groups
    assert (group["betas"], group["eps"]) == ((0.9, 0.999), 1e-5)


def test_save_and_load_give_the_same_actions(tmp_path: Path) -> None:
    model = VPG("CnnPolicy", Signs(), n_steps=16, gamma=0.9, n_value_steps=2, adam_beta1=0.5, seed=0)
    model.learn(64).save(tmp_path / "model.zip")
    loaded = VPG.load(tmp_path / "model.zip")
    assert (loaded.gamma, loaded.n_value_steps, loaded.value_learning_rate) == (0.9, 2, 1e-3)
    assert loaded.adam_beta1 == 0.5 and betas(loaded) == [(0.5, 0.999)] * 2
    assert torch.equal(flat(model), flat(loaded))
    images = np.random.default_rng(0).normal(size=(50, 8, 8, 1)).astype(np.float32)
    actions = [m.predict(images, deterministic=True)[0] for m in (model, loaded)]
    np.testing.assert_array_equal(*actions)
    drawn = []
    for m in (model, loaded):
        torch.manual_seed(5)
        drawn.append(m.predict(images)[0])
    np.testing.assert_array_equal(*drawn)


def test_continuing_after_load_equals_going_on() -> None:
    # An episode ends with each rollout, so a reset at the start of the second part changes nothing.
    whole = VPG("CnnPolicy", Signs(n_steps=16), n_steps=16, seed=0).learn(32)
    file = io.BytesIO()
    whole.save(file)
    file.seek(0)
    parts = VPG.load(file, env=Signs(n_steps=16))
    for model in (whole, parts):
        for optimizer in (model.policy.optimizer, model.policy.value_optimizer):
            assert {int(state["step"]) for state in optimizer.state.values()} <= {2, 2 * whole.n_value_steps}
        model.set_random_seed(7)
        model._last_obs = None
        model.learn(32, reset_num_timesteps=False)
    assert torch.equal(flat(whole), flat(parts))
    assert whole.num_timesteps == parts.num_timesteps == 64


def test_learning_rates_can_be_schedules() -> None:
    model = VPG("CnnPolicy", Signs(), lambda left: 1e-4 * left, lambda left: 1e-3 * left, n_steps=16, seed=0)
    model.learn(64)  # The last update is at progress 0: both rates are 0.
    assert model.policy.optimizer.param_groups[0]["lr"] == 0.0
    assert model.policy.value_optimizer.param_groups[0]["lr"] == 0.0


def test_logger_callbacks_and_tensorboard(tmp_path: Path) -> None:
    model = VPG("CnnPolicy", Signs(), n_steps=16, seed=0, tensorboard_log=str(tmp_path / "tb"))
    checkpoints = CheckpointCallback(save_freq=16, save_path=str(tmp_path))
    model.learn(32, callback=CallbackList([checkpoints]))
    assert [path.name for path in (tmp_path / "tb").iterdir()] == ["VPG_1"]
    assert len(list(tmp_path.glob("*.zip"))) == 2
    record = Record()
    model.set_logger(Logger(None, [record]))
    model.learn(32)
    assert record.rows[-1].keys() >= {
        f"train/{name}"
        for name in (
            "policy_loss",
            "value_loss",
            "explained_variance",
            "entropy",
            "n_updates",
            "learning_rate",
        )
    }
    assert record.rows[-1]["train/entropy"] == pytest.approx(np.log(2), abs=0.05)


@pytest.mark.parametrize(
    ("name", "value", "error", "words"),
    [
        ("gamma", 2.0, ValueError, r"gamma must be a number in \(0, 1\], not 2.0."),
        ("gamma", 0.0, ValueError, "gamma"),
        ("gamma", float("nan"), ValueError, "gamma"),
        ("gae_lambda", -0.1, ValueError, r"gae_lambda must be a number in \[0, 1\], not -0.1."),
        ("learning_rate", 0.0, ValueError, "learning_rate"),
        ("learning_rate", "1e-3", TypeError, "learning_rate"),
        ("value_learning_rate", -1e-3, ValueError, "value_learning_rate"),
        ("value_learning_rate", True, TypeError, "value_learning_rate"),
        ("n_steps", 1, ValueError, r"n_steps must be a whole number in \[2, 65536\], not 1."),
        ("n_steps", 64.0, TypeError, "n_steps"),
        ("n_value_steps", 0, ValueError, "n_value_steps"),
        ("n_value_steps", None, TypeError, "n_value_steps"),
        ("initial_value", float("inf"), ValueError, "initial_value"),
        ("adam_beta1", 1.0, ValueError, r"adam_beta1 must be a number in \[0, 1\), not 1.0."),
        ("adam_beta1", -0.1, ValueError, "adam_beta1"),
    ],
)
def test_refuses(name: str, value: object, error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words):
        VPG("CnnPolicy", Signs(), **{name: value})


def test_load_checks_what_it_is_given(tmp_path: Path) -> None:
    VPG("CnnPolicy", Signs(), n_steps=16).save(tmp_path / "model.zip")
    with pytest.raises(ValueError, match="gamma must be"):
        VPG.load(tmp_path / "model.zip", gamma=2.0)


def test_refuses_a_policy_of_another_kind() -> None:
    from stable_baselines3.common.policies import ActorCriticPolicy

    with pytest.raises(TypeError, match="policy must be derived from SeparatePolicy, not ActorCriticPolicy"):
        VPG(ActorCriticPolicy, "CartPole-v1")
