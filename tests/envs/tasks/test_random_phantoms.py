"""Phantoms that differ from episode to episode: what they are, and that they are what an episode shows."""

import pickle

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from usbench.envs.phantom import Phantom
from usbench.envs.pose import Pose
from usbench.envs.scanner import scan
from usbench.envs.tasks import random_phantoms
from usbench.envs.tasks.phantom_distribution import FIRST_HELD_OUT, PhantomDistribution
from usbench.envs.tasks.random_phantoms import FocalPointRandomEnv, ProbePlaneRandomEnv

ENVS = (FocalPointRandomEnv, ProbePlaneRandomEnv)


@pytest.mark.parametrize("env_class", ENVS)
def test_training_never_meets_a_phantom_of_evaluation(env_class, coded):
    env = env_class()
    numbers = {env.reset(seed=seed)[1]["phantom"] for seed in range(200)}
    assert len(numbers) == 200
    assert max(numbers) < FIRST_HELD_OUT
    assert env.reset(options={"phantom": FIRST_HELD_OUT})[1]["phantom"] == FIRST_HELD_OUT


def test_an_episode_shows_its_phantom_and_is_rewarded_by_it():
    env = ProbePlaneRandomEnv()
    frame, info = env.reset(seed=3)
    phantom = env.distribution.phantom(info["phantom"])
    pose = Pose(info["x_mm"], info["focal_depth_mm"], info["angle_deg"])
    np.testing.assert_array_equal(frame[:, :, 0], scan(phantom, pose))
    _, reward, _, _, info = env.step(0)
    lateral = abs(info["x_mm"] - phantom.object_of_interest.x_mm)
    assert info["distance_mm"] == lateral
    turned = np.radians(info["angle_deg"] - phantom.object_of_interest.angle_deg)
    assert reward == pytest.approx(-(lateral / 20 + abs(np.sin(turned))), abs=1e-12)


@pytest.mark.parametrize("env_class", ENVS)
def test_the_goal_is_over_the_object_of_the_episode(env_class, coded):
    env = env_class()
    for seed in range(20):
        _, info = env.reset(options={"phantom": seed})
        ooi = env.distribution.phantom(seed).object_of_interest
        place = {"x_mm": ooi.x_mm, "phantom": seed}
        place |= (
            {"focal_depth_mm": ooi.depth_mm}
            if env_class is FocalPointRandomEnv
            else {"angle_deg": ooi.angle_deg}
        )
        _, info = env.reset(options=place)
        assert info["is_success"] and info["distance_mm"] == 0


@pytest.mark.parametrize("env_class", ENVS)
def test_options_and_seeds_do_not_shift_the_stream(env_class, coded):
    plain, with_options = env_class(), env_class()
    plain.reset(seed=1)
    with_options.reset(seed=1, options={"phantom": 7, "x_mm": 0})
    assert plain.reset()[1] == with_options.reset()[1]


def test_the_same_seed_gives_the_same_bytes_after_pickling():
    first = ProbePlaneRandomEnv(noise=0.5)
    first.reset(seed=4)
    second = pickle.loads(pickle.dumps(first))
    for action in (1, 3):
        (one, *rest), (other, *more) = first.step(action), second.step(action)
        np.testing.assert_array_equal(one, other)
        assert rest == more


def test_gymnasium_finds_nothing_wrong(recwarn):
    check_env(gym.make("usbench/ProbePlaneRandom-v0").unwrapped, skip_render_check=True)
    assert not [warning for warning in recwarn if "gymnasium" in str(warning.filename)]


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"phantom": -1}, ValueError, r"phantom must be a whole number in \[0, 4294967295\], not -1"),
        ({"phantom": 2**32}, ValueError, "not 4294967296"),
        ({"phantom": 0.5}, ValueError, r"phantom must be a whole number in \[0, 4294967295\], not 0.5"),
        ({"phantom": "7"}, TypeError, r"phantom must be a whole number in \[0, 4294967295\], not '7'"),
        (
            {"phantm": 7},
            ValueError,
            "unknown option 'phantm' .did you mean 'phantom'.*deg', 'phantom'",
        ),
        ([7], TypeError, "options must be a dict with any of .*, angle_deg, phantom, not"),
    ],
)
def test_bad_options_are_refused(options, error, message, coded):
    with pytest.raises(error, match=message):
        ProbePlaneRandomEnv().reset(options=options)


def test_a_fixed_phantom_and_another_type_are_refused():
    with pytest.raises(TypeError, match="pass phantoms"):
        ProbePlaneRandomEnv(phantom=Phantom())
    with pytest.raises(TypeError, match="phantoms must be of type PhantomDistribution"):
        ProbePlaneRandomEnv(phantoms=Phantom())


def test_an_own_distribution_can_be_given(coded):
    distribution = PhantomDistribution((5,), (50,), (30,), scale=(0.8, 0.8), contrast=(8.0, 8.0))
    env = ProbePlaneRandomEnv(phantoms=distribution)
    env.reset(seed=0)
    assert env.target == Pose(5, 50, 30)
    assert env.phantom.object_of_interest.scale == 0.8


def test_a_task_that_refocuses_keeps_the_tables_of_all_its_depths(monkeypatch):
    asked = []
    monkeypatch.setattr(random_phantoms, "keep_tables", asked.append)
    for env_class in (ProbePlaneRandomEnv, FocalPointRandomEnv):
        env_class()
    assert asked == [1, 18]


def test_a_refused_reset_leaves_the_episode_as_it_is():
    env = ENVS[0]()
    env.start(seed=0)
    before = env.phantom, env.target, env.pose
    stream = env.np_random.bit_generator.state
    for options in ({"x_mm": 100}, {"phantom": -1}, {"phantom": 3, "depth": 4}):
        with pytest.raises(ValueError, match=r"x_mm|phantom|unknown option"):
            env.reset(seed=99, options=options)
    assert (env.phantom, env.target, env.pose) == before
    assert env.np_random.bit_generator.state == stream and env.np_random_seed == 0


def test_rewards_of_all_states_are_those_of_the_episodes_phantom(coded):
    env = ProbePlaneRandomEnv()
    with pytest.raises(gym.error.ResetNeeded, match="no phantom before"):
        env.state_rewards()
    for seed in (3, 4):
        env.reset(seed=seed)
        best = env.task.states[int(env.state_rewards().argmax())]
        assert (best.x_mm, best.angle_deg % 180) == (env.target.x_mm, env.target.angle_deg % 180)
