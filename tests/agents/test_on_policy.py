"""Values of a rollout, computed at its end, and TRPO's gradients, computed at once, are those of SB3."""

import numpy as np
import pytest
import sb3_contrib
import torch
from stable_baselines3.common.envs import IdentityEnvBox
from stable_baselines3.common.policies import ActorCriticPolicy

from usbench.agents import on_policy
from usbench.agents.policies import SeparatePolicy
from usbench.agents.vpg import VPG

CARTPOLE = {"policy": SeparatePolicy, "env": "CartPole-v1", "n_steps": 128, "seed": 0, "device": "cpu"}


@pytest.mark.parametrize("cls", [on_policy.A2C, on_policy.PPO, on_policy.TRPO, VPG])
@pytest.mark.parametrize("n_envs", [1, 3])
def test_values_are_those_of_the_network_that_acted(monkeypatch, cls, n_envs):
    from stable_baselines3.common.env_util import make_vec_env

    monkeypatch.setattr(on_policy, "OBSERVATIONS_AT_ONCE", 50)
    model = cls(**CARTPOLE | {"env": make_vec_env("CartPole-v1", n_envs, seed=0)})
    model.train = lambda: None
    model.learn(128 * n_envs)
    rollout = model.rollout_buffer
    with torch.no_grad():
        for seen, values in zip(rollout.observations, rollout.values, strict=True):
            expected = model.policy.predict_values(torch.as_tensor(seen)).flatten().numpy()
            np.testing.assert_allclose(values, expected, rtol=1e-5, atol=1e-6)


def test_forward_leaves_values_out_only_where_they_are_computed_afterwards():
    model = on_policy.PPO(**CARTPOLE)
    images = torch.zeros(2, 4)
    assert model.policy(images)[1].isnan().all()
    model.policy.values_at_end = False
    assert not model.policy(images)[1].isnan().any()


@pytest.mark.parametrize("n", [1, 7])
def test_drawn_actions_have_the_bits_of_sb3(n):
    policy = on_policy.PPO(**CARTPOLE).policy
    seen = torch.randn(n, 4)
    with torch.no_grad():
        for seed in range(20):
            torch.manual_seed(seed)
            actions, _, log_prob = policy(seen)
            torch.manual_seed(seed)
            expected, _, expected_log_prob = ActorCriticPolicy.forward(policy, seen)
            assert torch.equal(actions, expected) and torch.equal(log_prob, expected_log_prob)


def test_a_network_that_is_not_finite_draws_no_action():
    policy = on_policy.PPO(**CARTPOLE).policy
    with pytest.raises(RuntimeError, match="nan"):
        policy(torch.full((1, 4), torch.nan))


def test_actions_that_are_numbers_keep_their_shape():
    model = on_policy.PPO(SeparatePolicy, IdentityEnvBox(), n_steps=8, batch_size=8, seed=0, device="cpu")
    model.learn(8)
    assert model.rollout_buffer.actions.shape == (8, 1)


def test_trpo_has_the_gradients_of_sb3_contrib():
    model = on_policy.TRPO(**CARTPOLE)
    seen = torch.randn(16, 4)
    distribution = model.policy.get_distribution(seen).distribution
    divergence, objective = distribution.entropy().mean(), distribution.logits[:, 0].mean()
    ours, theirs = (
        cls._compute_actor_grad(model, divergence, objective) for cls in (on_policy.TRPO, sb3_contrib.TRPO)
    )
    assert {id(part) for part in ours[0]} == {id(part) for part in theirs[0]} and ours[3] == theirs[3]
    for one, other in zip(ours[1:3], theirs[1:3], strict=True):
        torch.testing.assert_close(one, other)


def test_policy_with_a_shared_network_gives_its_values_step_by_step():
    model = on_policy.A2C(ActorCriticPolicy, "CartPole-v1", n_steps=8, seed=0, device="cpu")
    model.learn(8)
    assert model.rollout_buffer.policy is None and np.isfinite(model.rollout_buffer.values).all()
