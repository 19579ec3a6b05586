"""Senses: what an agent is told of a tracked probe and of its own actions, and never of the object."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import usbench  # noqa: F401, registers the environments
from usbench.envs.observation import senses
from usbench.envs.observation.wrappers import ImageStack, NormalizeImage
from usbench.envs.tasks.examination import EXAMINATION, EXAMINATION_STOP
from usbench.envs.tasks.focal_point import FOCAL_POINT
from usbench.envs.tasks.probe_plane import PROBE_PLANE
from usbench.envs.tasks.random_phantoms import PROBE_PLANE_RANDOM

ALL = ("position", "focus", "heading", "actions")


def unwatched(env_id, **kwargs):
    """An environment whose frames are black: none is simulated."""
    env = gym.make(env_id, **kwargs)
    env.unwrapped.is_watched = False
    return env


@pytest.mark.parametrize(
    ("task", "names"),
    [
        (FOCAL_POINT, ("position", "focus", "actions")),
        (PROBE_PLANE, ("position", "heading", "actions")),
        (PROBE_PLANE_RANDOM, ("position", "heading", "actions")),
        (EXAMINATION, ALL),
        (EXAMINATION_STOP, ALL),
    ],
    ids=lambda value: getattr(value, "name", None),
)
def test_a_task_has_the_senses_of_what_changes_in_it(task, names):
    assert senses.available(task) == names


def test_values_are_those_of_the_pose_after_the_noise_and_of_the_agents_own_action():
    env = unwatched("usbench/Examination-v0", senses=ALL, noise=1.0)
    start = {"x_mm": 10, "focal_depth_mm": 45, "angle_deg": 30}
    observation, _ = env.reset(seed=0, options=start)
    assert np.allclose(observation["senses"], [0.5, 0.5, 0.5, np.sqrt(3) / 2, 0, 0, 0, 0, 0, 0, 0])
    observation, _, _, _, info = env.step(4)
    assert info["noise"], "the probe slipped"
    angle = np.radians(info["angle_deg"])
    told = [info["x_mm"] / 20, info["focal_depth_mm"] / 90, np.sin(angle), np.cos(angle)]
    assert np.allclose(observation["senses"], [*told, 0, 0, 0, 0, 1, 0, 0])


def test_a_reset_forgets_the_last_action():
    env = unwatched("usbench/ProbePlane-v0", senses=("actions",))
    env.reset(seed=0)
    assert env.step(2)[0]["senses"].tolist() == [0, 0, 1, 0, 0]
    assert not env.reset()[0]["senses"].any()


def test_nothing_is_told_of_the_object():
    env = unwatched("usbench/ProbePlaneRandom-v0", senses=("position", "heading", "actions"))
    told = []
    for phantom in range(5):
        env.reset(seed=0, options={"x_mm": 5, "angle_deg": 60, "phantom": phantom})
        told.append(env.step(3)[0]["senses"])
    assert len({env.unwrapped.phantoms.phantom(number).target for number in range(5)}) > 1
    assert all(np.array_equal(one, told[0]) for one in told)


def test_the_order_of_names_does_not_matter_and_twice_is_once():
    one, other = (
        unwatched("usbench/ProbePlane-v0", senses=names)
        for names in (("heading", "position"), ["position", "heading", "heading"])
    )
    assert one.unwrapped.senses == other.unwrapped.senses
    assert one.unwrapped.senses.names == ("position", "heading")


def test_without_senses_the_observation_is_the_frame_as_ever():
    env = unwatched("usbench/ProbePlane-v0")
    assert env.observation_space == gym.spaces.Box(0, 255, (90, 40, 1), np.uint8)
    assert env.reset(seed=0)[0].shape == (90, 40, 1)


@pytest.mark.parametrize("env_id", ["usbench/ProbePlane-v0", "usbench/Examination-v0"])
def test_gymnasiums_checks_pass_with_senses(env_id):
    env = gym.make(env_id, senses=("position", "heading", "actions")).unwrapped
    env.is_watched = False
    check_env(env, skip_render_check=True)


def test_stacked_senses_are_those_of_the_stacked_frames():
    env = NormalizeImage(ImageStack(unwatched("usbench/ProbePlane-v0", senses=("position",)), 3))
    assert env.observation_space["image"].shape == (90, 40, 3)
    assert env.observation_space["senses"].shape == (3,)
    seen = [env.reset(seed=0, options={"x_mm": 0})[0]] + [env.step(action)[0] for action in (2, 2, 1)]
    assert [one["senses"].tolist() for one in seen] == [
        [0, 0, 0], [0, 0, 0.25], [0, 0.25, 0.5], [0.25, 0.5, 0.25],
    ]  # fmt: skip
    assert all(env.observation_space.contains(one) for one in seen)


def test_observations_are_equal_where_images_and_senses_are():
    image, told = np.arange(8).reshape(2, 2, 2), np.array([0.5, 1])
    seen = {"image": image, "senses": told}
    assert senses.equal(image, image.copy()) and senses.equal(seen, {"image": image.copy(), "senses": told})
    for other in (image, image + 1, {**seen, "image": image + 1}, {**seen, "senses": told + 1}):
        assert not senses.equal(seen, other)
    assert not senses.equal(image, image + 1)


@pytest.mark.parametrize(
    ("names", "error", "words"),
    [
        (("smell",), ValueError, "unknown sense 'smell': allowed are 'position', 'focus', 'heading'"),
        (("focus",), ValueError, "the task 'pp' has no sense 'focus'"),
        ("heading", TypeError, "senses must be a sequence of names"),
    ],
)
def test_wrong_senses_are_refused(names, error, words):
    with pytest.raises(error, match=words):
        gym.make("usbench/ProbePlane-v0", senses=names)
