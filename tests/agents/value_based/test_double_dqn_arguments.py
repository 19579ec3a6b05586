"""Arguments of double DQN: what is refused, and what reaches buffer and policy, also after `load`."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from pp_tracked import SYMMETRIES
from signs import Signs
from small_double_dqn import model
from stable_baselines3.common.vec_env import DummyVecEnv

from usbench.agents.value_based.double_dqn import DoubleDQN


@pytest.mark.parametrize(
    "settings", [{"symmetries": SYMMETRIES}, {"max_shift_px": 2}, {"greedy_shift_px": 2}]
)
def test_images_with_channels_in_front_have_no_views_and_shifts(settings):
    class Transposed(gym.Env):
        observation_space, action_space = spaces.Box(0, 255, (1, 40, 30), np.uint8), spaces.Discrete(5)

    with pytest.raises(ValueError, match="need images .height, width, channels.*NormalizeImage"):
        DoubleDQN("CnnPolicy", DummyVecEnv([Transposed]), buffer_size=10, **settings)


def test_arguments_of_the_buffer_leave_its_returns_as_they_are():
    given = {"handle_timeout_termination": True}
    env = DummyVecEnv([Signs])
    agent = DoubleDQN("MlpPolicy", env, gamma=0.5, return_steps=2, buffer_size=10, replay_buffer_kwargs=given)
    assert (agent.replay_buffer.n_steps, agent.replay_buffer.gamma) == (2, 0.5)
    assert given == {"handle_timeout_termination": True}


@pytest.mark.parametrize(
    ("name", "value", "error", "words"),
    [
        ("gamma", 1.5, ValueError, r"gamma must be a number in \(0, 1\], not 1.5."),
        ("return_steps", 0, ValueError, r"return_steps must be a whole number in \[1, 100\], not 0."),
        ("return_steps", -2, ValueError, "return_steps"),
        ("return_steps", 2.5, TypeError, r"return_steps must be a whole number in \[1, 100\], not 2.5."),
        ("max_shift_px", -1, ValueError, r"max_shift_px must be a whole number in \[0, 100\], not -1."),
        ("greedy_shift_px", -1, ValueError, r"greedy_shift_px must be a whole number in \[0, 10\], not -1."),
        ("learning_rate", -1.0, ValueError, "learning_rate must be"),
        ("final_learning_rate", float("nan"), ValueError, "final_learning_rate must be"),
    ],
)
def test_refuses(name, value, error, words):
    with pytest.raises(error, match=f"^{words}"):
        DoubleDQN("MlpPolicy", DummyVecEnv([Signs]), buffer_size=10, **{name: value})


def test_what_load_is_given_reaches_buffer_and_policy(tmp_path):
    agent = model(greedy_shift_px=2, return_steps=3)
    agent.save(tmp_path / "model.zip")
    given = {"gamma": 0.5, "return_steps": 1, "greedy_shift_px": 0}
    loaded = DoubleDQN.load(tmp_path / "model.zip", device="cpu", **given)
    assert (loaded.replay_buffer.gamma, loaded.replay_buffer.n_steps) == (0.5, 1)
    assert loaded.policy.greedy_shift_px == 0
    again = DoubleDQN.load(tmp_path / "model.zip", device="cpu")
    assert (again.replay_buffer.gamma, again.replay_buffer.n_steps) == (agent.gamma, 3)
    assert again.policy.greedy_shift_px == 2
    with pytest.raises(ValueError, match="return_steps must be"):
        DoubleDQN.load(tmp_path / "model.zip", device="cpu", return_steps=0)


def test_arguments_of_buffer_and_policy_win_also_after_load(tmp_path):
    given = {"replay_buffer_kwargs": {"n_steps": 4}, "policy_kwargs": {"greedy_shift_px": 1}}
    agent = DoubleDQN("MlpPolicy", DummyVecEnv([Signs]), gamma=0.5, buffer_size=10, **given)
    agent.save(tmp_path / "model.zip")
    for one in (agent, DoubleDQN.load(tmp_path / "model.zip", device="cpu", return_steps=2)):
        assert (one.replay_buffer.n_steps, one.replay_buffer.gamma) == (4, 0.5)
        assert one.policy.greedy_shift_px == 1
