"""The update, step by step and against numbers worked out by hand, and that it learns."""

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch
from signs import Signs, changed, clone
from torch import nn

from usbench.agents.networks import Block
from usbench.agents.vpg import VPG, RewardToGoBuffer, _descend


def of_value(name: str) -> bool:
    return name.startswith(("vf_features_extractor", "value_net", "mlp_extractor.value_net"))


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


def test_a_step_without_momentum_has_the_size_of_the_learning_rate() -> None:
    # Adam's first step is lr * g / (|g| + eps); the second, at beta_1 = 0, is lr * g2 / sqrt(v), with
    # v = (b g1^2 + g2^2) / (1 + b), b = 0.999: it looks at g1 for its size and never for its direction.
    g1, g2 = np.array([3.0, 1.0]), np.array([-1.0, 2.0])
    model = VPG("MlpPolicy", "CartPole-v1", learning_rate=1e-2, device="cpu", seed=0)
    bias = model.policy.action_net.bias
    steps = []
    for gradient in (g1, g2):
        before = bias.detach().clone()
        _descend(model.policy.optimizer, (bias * torch.as_tensor(gradient, dtype=torch.float32)).sum())
        steps.append((bias.detach() - before).numpy())
    np.testing.assert_allclose(steps[0], -1e-2 * np.sign(g1), rtol=1e-4)
    np.testing.assert_allclose(steps[1], -1e-2 * g2 / np.sqrt((0.999 * g1**2 + g2**2) / 1.999), rtol=1e-4)


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
    # Acting: one image at a time, and all values at the end. Learning: the whole rollout, in 2 layers, in
    # each of the 1 + 3 steps.
    assert [mode for mode in seen if mode[0]] == [(True, 16)] * 2 * (1 + 3)
    assert {size for training, size in seen if not training} == {1, 16}
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


@pytest.mark.parametrize("dtype", [np.float32, pytest.param(np.uint8, marks=pytest.mark.slow)])
def test_learns_a_trivial_environment(dtype: type) -> None:
    model = VPG("CnnPolicy", Signs(dtype=dtype), learning_rate=1e-3, gae_lambda=0.0, gamma=0.5, seed=0)
    model.learn(64 * 25)
    if dtype is np.float32:
        assert mean_reward(model) > 0.95
    assert np.mean([episode["r"] for episode in list(model.ep_info_buffer)[-20:]]) > 0.85 * 8


def test_values_start_from_initial_value() -> None:
    images = torch.zeros(4, 8, 8, 1)
    low, high = (
        VPG("CnnPolicy", Signs(), seed=0, initial_value=value).policy.predict_values(images)
        for value in (-130.0, 0.0)
    )
    torch.testing.assert_close(low, high - 130.0)
