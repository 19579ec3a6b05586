import io
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch
from stable_baselines3.common.callbacks import CallbackList, CheckpointCallback
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.logger import KVWriter, Logger
from torch import nn

from usbench.agents.networks import Block
from usbench.agents.vpg import VPG, RewardToGoBuffer


@pytest.fixture(autouse=True)
def _one_thread() -> None:
    torch.set_num_threads(1)


class Signs(gym.Env[np.ndarray, int]):
    """A bright half of the image says which of two actions is right: reward 1 for it, else 0."""

    action_space = gym.spaces.Discrete(2)

    def __init__(self, n_steps: int = 8, dtype: type = np.float32) -> None:
        low, high = (0, 255) if dtype is np.uint8 else (-3.0, 3.0)
        self.observation_space = gym.spaces.Box(low, high, (8, 8, 1), dtype)
        self.dtype, self.n_steps = dtype, n_steps

    def _image(self) -> np.ndarray:
        self.right = int(self.np_random.integers(2))
        bright = np.arange(8)[:, None, None] // 4 == self.right
        image = np.where(bright, 1.0, -1.0) + self.np_random.normal(0, 0.3, (8, 8, 1))
        return (
            (image * 40 + 120).clip(0, 255).astype(np.uint8)
            if self.dtype is np.uint8
            else image.astype(np.float32)
        )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict]:
        super().reset(seed=seed)
        self.step_number = 0
        return self._image(), {}

    def step(self, action: int) -> tuple[np.ndarray, float, bool, bool, dict]:
        reward = float(int(action) == self.right)
        self.step_number += 1
        return self._image(), reward, False, self.step_number == self.n_steps, {}


class Record(KVWriter):
    """Keeps what is logged."""

    def __init__(self) -> None:
        self.rows: list[dict[str, Any]] = []

    def write(self, key_values: dict[str, Any], key_excluded: dict[str, Any], step: int = 0) -> None:
        self.rows.append(dict(key_values))


def clone(module: nn.Module) -> dict[str, torch.Tensor]:
    return {name: tensor.clone() for name, tensor in module.state_dict().items()}


def changed(before: dict[str, torch.Tensor], module: nn.Module) -> set[str]:
    return {name for name, tensor in module.state_dict().items() if not torch.equal(tensor, before[name])}


def of_value(name: str) -> bool:
    return name.startswith(("vf_features_extractor", "value_net", "mlp_extractor.value_net"))


def flat(model: VPG) -> torch.Tensor:
    return torch.cat([tensor.double().flatten() for tensor in model.policy.state_dict().values()])


def mean_reward(model: VPG, n: int = 200) -> float:
    env = Signs(n_steps=n)
    image, _ = env.reset(seed=99)
    total = 0.0
    for _ in range(n):
        image, reward, *_ = env.step(int(model.predict(image, deterministic=True)[0]))
        total += reward
    return total / n


def buffer(
    rewards: list[float], values: list[float], starts: list[int], gamma: float, lam: float
) -> RewardToGoBuffer:
    space = gym.spaces.Box(-1, 1, (1,), np.float32)
    rollout = RewardToGoBuffer(
        len(rewards), space, gym.spaces.Discrete(2), "cpu", gae_lambda=lam, gamma=gamma
    )
    for reward, value, start in zip(rewards, values, starts, strict=True):
        one = np.zeros((1, 1))
        rollout.add(one, one, np.array([reward]), np.array([start]), torch.tensor([value]), torch.zeros(1))
    return rollout


def test_advantages_and_rewards_to_go_by_hand() -> None:
    # gamma 0.5, lambda 0.5. Steps 0, 1 end an episode; steps 2, 3 begin one that is cut, V(next) = 8.
    rollout = buffer([1.0, 2.0, 3.0, 4.0], [10.0, 20.0, 30.0, 40.0], [1, 0, 1, 0], 0.5, 0.5)
    rollout.compute_returns_and_advantage(torch.tensor([[8.0]]), np.array([False]))
    # deltas: 1 + 0.5*20 - 10 = 1;  2 - 20 = -18;  3 + 0.5*40 - 30 = -7;  4 + 0.5*8 - 40 = -32
    # advantages: 1 + 0.25*(-18) = -3.5;  -18;  -7 + 0.25*(-32) = -15;  -32
    np.testing.assert_allclose(rollout.advantages.flatten(), [-3.5, -18.0, -15.0, -32.0])
    # rewards-to-go: 1 + 0.5*2 = 2;  2;  3 + 0.5*8 = 7;  4 + 0.5*8 = 8
    np.testing.assert_allclose(rollout.returns.flatten(), [2.0, 2.0, 7.0, 8.0])


def test_a_rollout_that_ends_with_an_episode_takes_nothing_from_the_next() -> None:
    rollout = buffer([1.0, 2.0], [10.0, 20.0], [1, 0], 0.5, 0.5)
    rollout.compute_returns_and_advantage(torch.tensor([[1000.0]]), np.array([True]))
    np.testing.assert_allclose(rollout.returns.flatten(), [2.0, 2.0])
    np.testing.assert_allclose(rollout.advantages.flatten(), [-3.5, -18.0])


def test_truncation_bootstraps_from_the_last_image() -> None:
    # Episodes of 3 steps, rollout of 4: one truncation inside, one episode cut at the end.
    model = VPG("CnnPolicy", Signs(n_steps=3), n_steps=4, gamma=0.5, gae_lambda=1.0, seed=0)
    with torch.no_grad():
        model.policy.value_net.weight.zero_()
        model.policy.value_net.bias.fill_(6.0)  # V = 6 everywhere
    raw: list[float] = []
    step = model.env.step_wait

    def watched() -> Any:
        result = step()
        raw.append(float(result[1][0]))
        return result

    model.env.step_wait = watched
    model.train = lambda: None
    model.learn(4)
    a, b, c, d = raw
    expected = [a + 0.5 * (b + 0.5 * (c + 0.5 * 6)), b + 0.5 * (c + 0.5 * 6), c + 0.5 * 6, d + 0.5 * 6]
    np.testing.assert_allclose(model.rollout_buffer.returns.flatten(), expected, rtol=1e-6)
    # With lambda 1 the advantage is the reward-to-go less the value.
    np.testing.assert_allclose(model.rollout_buffer.advantages.flatten(), np.array(expected) - 6, rtol=1e-5)


def test_one_policy_step_and_the_asked_value_steps_per_update() -> None:
    model = VPG("CnnPolicy", Signs(), n_steps=16, n_value_steps=5, seed=0)
    model.learn(3 * 16)
    assert {int(state["step"]) for state in model.policy.optimizer.state.values()} == {3}
    assert {int(state["step"]) for state in model.policy.value_optimizer.state.values()} == {15}
    assert model._n_updates == 3


def test_251_updates_in_the_papers_budget() -> None:
    model = VPG("CnnPolicy", Signs(n_steps=16), seed=0)
    updates: list[int] = []

    def rollout(*_: object, n_rollout_steps: int) -> bool:
        model.num_timesteps += n_rollout_steps
        return True

    model.collect_rollouts = rollout
    model.train = lambda: updates.append(model.num_timesteps)
    model.learn(16_064)
    assert updates == list(range(64, 16_064 + 1, 64))
    assert len(updates) == 251


def test_policy_and_value_steps_leave_each_other_alone() -> None:
    model = VPG("CnnPolicy", Signs(), n_steps=16, seed=0)
    model.learn(16)
    model.policy.set_training_mode(True)
    rollout = next(model.rollout_buffer.get())
    before = clone(model.policy)
    model._policy_step(rollout.observations, rollout.actions, rollout.advantages)
    after_policy = changed(before, model.policy)
    assert after_policy
    assert not any(of_value(name) for name in after_policy)
    before = clone(model.policy)
    model._value_step(rollout.observations, rollout.returns)
    after_value = changed(before, model.policy)
    assert after_value
    assert all(of_value(name) for name in after_value)


def test_policy_step_is_the_textbook_gradient() -> None:
    model = VPG("CnnPolicy", Signs(), n_steps=16, seed=3, policy_kwargs={"optimizer_class": torch.optim.SGD})
    model.learn(16)
    rollout = next(model.rollout_buffer.get())
    # Rows of the gradient for the output's bias: -mean((onehot - probabilities) * A).
    model.policy.set_training_mode(True)
    probabilities = model.policy.get_distribution(rollout.observations).distribution.probs.detach()
    advantages = (rollout.advantages - rollout.advantages.mean()) / (rollout.advantages.std() + 1e-8)
    onehot = nn.functional.one_hot(rollout.actions.long().flatten(), 2)
    expected = -((onehot - probabilities) * advantages[:, None]).mean(0)
    bias = model.policy.action_net.bias
    before = bias.detach().clone()
    model._policy_step(rollout.observations, rollout.actions, rollout.advantages)
    torch.testing.assert_close(before - bias.detach(), 1e-4 * expected, rtol=1e-3, atol=1e-9)


def test_batch_norm_acts_on_running_statistics_and_learns_on_the_batch() -> None:
    model = VPG("CnnPolicy", Signs(), n_steps=16, n_value_steps=3, seed=0)
    norms = [module for module in model.policy.modules() if isinstance(module, nn.BatchNorm2d)]
    seen: list[tuple[bool, int]] = []
    for block in (module for module in model.policy.modules() if isinstance(module, Block)):
        block.register_forward_hook(lambda block, inputs, _: seen.append((block.training, len(inputs[0]))))
    model.learn(16)
    # Acting: one image at a time. Learning: the whole rollout, in 2 layers, in each of the 1 + 3 steps.
    assert [mode for mode in seen if mode[0]] == [(True, 16)] * 2 * (1 + 3)
    assert {size for training, size in seen if not training} == {1}
    updates = [int(norm.num_batches_tracked) for norm in norms]
    assert sorted(updates) == [1, 1, 3, 3]
    state = clone(model.policy)
    model.predict(np.zeros((5, 8, 8, 1), np.float32))
    assert not changed(state, model.policy)


def test_both_batch_norm_modes_come_to_agree() -> None:
    model = VPG("CnnPolicy", Signs(), seed=0)
    model.learn(64 * 20)
    images = torch.as_tensor(model.rollout_buffer.observations)
    state = clone(model.policy)
    logits = []
    for training in (False, True):
        model.policy.load_state_dict(state)
        model.policy.set_training_mode(training)
        with torch.no_grad():
            logits.append(model.policy.get_distribution(images).distribution.logits)
    divergence = (logits[0].exp() * (logits[0] - logits[1])).sum(1).mean()
    assert 0 <= float(divergence) < 0.02


@pytest.mark.parametrize("dtype", [np.float32, np.uint8])
def test_learns_a_trivial_environment(dtype: type) -> None:
    model = VPG("CnnPolicy", Signs(dtype=dtype), learning_rate=1e-3, gae_lambda=0.0, gamma=0.5, seed=0)
    model.learn(64 * 25)
    if dtype is np.float32:
        assert mean_reward(model) > 0.95
    assert np.mean([episode["r"] for episode in list(model.ep_info_buffer)[-20:]]) > 0.85 * 8


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


def test_values_start_from_initial_value() -> None:
    images = torch.zeros(4, 8, 8, 1)
    low, high = (
        VPG("CnnPolicy", Signs(), seed=0, initial_value=value).policy.predict_values(images)
        for value in (-130.0, 0.0)
    )
    torch.testing.assert_close(low, high - 130.0)


def test_save_and_load_give_the_same_actions(tmp_path: Path) -> None:
    model = VPG("CnnPolicy", Signs(), n_steps=16, gamma=0.9, n_value_steps=2, seed=0).learn(64)
    model.save(tmp_path / "model.zip")
    loaded = VPG.load(tmp_path / "model.zip")
    assert (loaded.gamma, loaded.n_value_steps, loaded.value_learning_rate) == (0.9, 2, 1e-3)
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
