"""PPO with an asymmetric critic: the truth goes into values and into nothing else."""

import numpy as np
import pytest
import torch
import trials
from gymnasium import spaces
from signs import Signs
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.vec_env import DummyVecEnv

from usbench import records
from usbench.agents import zoo
from usbench.agents.asymmetric.policy import Known
from usbench.agents.asymmetric.ppo import AsymmetricPPO
from usbench.agents.asymmetric.truth import SIZE, states
from usbench.setting import Setting
from usbench.trials import runner
from usbench.trials.configuration import resolve
from usbench.trials.model_loading import load_agent

SMALL = {"n_steps": 32, "batch_size": 16, "n_epochs": 2}


class Moving(Signs):
    """Signs whose action space is not discrete."""

    action_space = spaces.Box(-1, 1, (1,), np.float32)


class Untold(Signs):
    """Signs that tell no truth."""

    def _truth(self):
        return {}


def model(env=Signs, n_envs=2, **overrides):
    chosen = zoo.hyperparameters("ppo_asymmetric", "pp", SMALL | overrides)
    return zoo.make("ppo_asymmetric", DummyVecEnv([env] * n_envs), 3, chosen, device="cpu")


def filled(agent):
    """The model with a rollout that it has collected and not learned from yet."""
    agent.learn(64)
    callback = agent._init_callback(None)
    assert agent.collect_rollouts(agent.env, callback, agent.rollout_buffer, agent.n_steps)
    return agent


def test_the_policy_sees_observations_alone_and_the_critic_states_alone():
    policy = model().policy
    policy.set_training_mode(False)
    generator = torch.Generator().manual_seed(0)
    seen, other = torch.randn(2, 6, 8, 8, 1, generator=generator)
    true, untrue = torch.randn(2, 6, SIZE, generator=generator)
    actions = torch.zeros(6)
    values, log_prob, entropy = policy.evaluate_actions(Known(seen, true), actions)
    told_otherwise = policy.evaluate_actions(Known(seen, untrue), actions)
    seen_otherwise = policy.evaluate_actions(Known(other, true), actions)
    assert torch.equal(log_prob, told_otherwise[1]) and torch.equal(entropy, told_otherwise[2])
    assert torch.equal(values, seen_otherwise[0])
    assert not torch.allclose(values, told_otherwise[0])
    assert not torch.allclose(log_prob, seen_otherwise[1])
    # Nor does a gradient lead from one to the other: they share no weight.
    values.sum().backward()
    assert all(parameter.grad is None for parameter in policy.policy_parameters())
    assert all(parameter.grad is not None for parameter in policy.value_parameters())


def test_the_states_of_a_rollout_are_those_of_its_observations():
    rollout = filled(model()).rollout_buffer
    # The bright half of an image of Signs tells its truth, x of 0 or 20 mm, also where episodes end.
    rows = rollout.observations.mean((3, 4))
    is_right = rows[:, :, 4:].mean(2) > rows[:, :, :4].mean(2)
    assert rollout.episode_starts.sum() >= 4
    np.testing.assert_array_equal(rollout.states[:, :, 0], is_right)
    assert 0 < is_right.mean() < 1


def test_samples_keep_states_and_observations_together():
    rollout = filled(model()).rollout_buffer
    for batch in rollout.get(16):
        images, told = batch.observations
        is_right = images[:, 4:].mean((1, 2, 3)) > images[:, :4].mean((1, 2, 3))
        assert torch.equal(told[:, 0] == 1, is_right)


def test_values_and_returns_of_a_rollout_are_those_of_its_states():
    agent = model(gae_lambda=1.0)
    filled(agent)
    rollout, last = agent.rollout_buffer, agent._last_states
    expected = RolloutBuffer(16, agent.observation_space, agent.action_space, "cpu", 1.0, agent.gamma, 2)
    with torch.no_grad():
        expected.values = agent.policy.values(torch.as_tensor(rollout.states)).numpy()[..., 0]
        last_values = agent.policy.values(torch.as_tensor(last))
    expected.rewards, expected.episode_starts = rollout.rewards, rollout.episode_starts
    expected.compute_returns_and_advantage(last_values, agent._last_episode_starts)
    np.testing.assert_allclose(rollout.values, expected.values, rtol=1e-5)
    np.testing.assert_allclose(rollout.returns, expected.returns, rtol=1e-5)


def test_an_episode_that_is_cut_off_ends_with_the_value_of_its_last_state():
    agent = model(gamma=0.5)
    infos = [{"x_mm": 20, "TimeLimit.truncated": True}, {"x_mm": 10}]
    rewards = np.ones(2, np.float32)
    agent._value_truncated_ends(rewards, np.array([True, True]), infos)
    with torch.no_grad():
        value = float(agent.policy.values(torch.as_tensor(states(infos[:1]))))
    assert rewards == pytest.approx([1 + 0.5 * value, 1.0])


def test_no_value_follows_from_observations():
    with pytest.raises(TypeError, match=r"from states, not from observations alone \(Tensor\)"):
        model().policy.predict_values(torch.zeros(2, 8, 8, 1))


def test_a_saved_model_knows_no_truth_and_acts_as_before(tmp_path):
    agent = filled(model())
    agent.save(tmp_path / "model.zip")
    loaded = AsymmetricPPO.load(tmp_path / "model.zip", device="cpu")
    assert loaded._last_states is None and loaded.observation_space == Signs().observation_space
    seen = agent._last_obs
    np.testing.assert_array_equal(
        loaded.predict(seen, deterministic=True)[0], agent.predict(seen, deterministic=True)[0]
    )
    # It learns on where it is given environments again.
    loaded.set_env(DummyVecEnv([Signs] * 2))
    assert loaded.learn(32, reset_num_timesteps=False).num_timesteps > agent.num_timesteps


def test_a_loaded_model_goes_on_with_new_episodes(tmp_path):
    model().learn(64).save(tmp_path / "model.zip")
    env = DummyVecEnv([Signs] * 2)
    again = AsymmetricPPO.load(tmp_path / "model.zip", env=env, device="cpu", force_reset=False)
    again.learn(64, reset_num_timesteps=False)
    assert again.num_timesteps == 128


def test_refuses_environments_without_truth_and_other_actions():
    with pytest.raises(ValueError, match="the info of the environment must tell a state"):
        model(Untold).learn(32)
    with pytest.raises(ValueError, match="the actions must be Discrete, not Box"):
        model(Moving)


@pytest.mark.slow
def test_learns_a_trivial_environment():
    agent = model(n_steps=128, batch_size=32, n_epochs=6, learning_rate=1e-3).learn(1536)
    env, right = Signs(), 0
    observation, _ = env.reset(seed=1)
    for _ in range(100):
        action, _ = agent.predict(observation, deterministic=True)
        observation, reward, *_ = env.step(int(action))
        right += int(reward)
    assert right >= 95


@pytest.mark.parametrize("symmetric_views", [False, True])
def test_a_killed_trial_on_a_tracked_task_ends_with_the_bits_of_an_undisturbed_one(
    often, tmp_path, symmetric_views
):
    config = resolve(
        "ppo_asymmetric",
        "pp-tracked",
        steps=96,
        n_envs=2,
        n_frames=2,
        overrides=trials.SMALL["ppo_asymmetric"] | {"symmetric_views": symmetric_views},
    )
    whole = runner.run_trial(config, tmp_path / "whole").folder
    with pytest.raises(trials.Killed):
        runner.run_trial(config, tmp_path / "killed", progress=trials.Until(64))
    progress = trials.Until()
    killed = runner.run_trial(config, tmp_path / "killed", progress=progress).folder
    assert progress.first > 32
    assert trials.bits(killed) == trials.bits(whole)
    # What acts is given what every agent is given: two frames and senses, and no truth.
    agent, env = load_agent(whole).agent, Setting.recorded(config).make_env()
    observation, info = env.reset(seed=0)
    assert set(observation) == {"image", "senses"} and "target_x_mm" in info
    assert agent.observation_space == env.observation_space
    assert int(agent.predict(observation, deterministic=True)[0]) in range(5)
    assert (whole / records.MODEL).exists()
