"""Environments with another imaging and another probe: spaces, pictures and rewards follow them."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import usbench  # noqa: F401
from usbench.envs.bmode import Imaging
from usbench.envs.image_reward import likeness, standard_view
from usbench.envs.observation.wrappers import ImageStack, NormalizeImage
from usbench.envs.probe import LinearArray

OTHERS = {
    "128 x 128": {"imaging": Imaging(height_px=128, width_px=128)},
    "64 x 64": {"imaging": Imaging(height_px=64, width_px=64)},
    "half a mm": {"imaging": Imaging(height_px=140, width_px=80, pixel_size=0.5e-3)},
    "60 mm wide": {"imaging": Imaging(width_px=60), "probe": LinearArray(n_lines=96)},
}
# Starts and actions with few response tables: one focal depth for all tasks, a low frequency.
WALKS = {
    "ProbePlane-v0": ({}, 1),
    "FocalPointRandom-v0": ({"focal_depth_mm": 50}, 1),
    "ImagingSetup-v1": ({"focal_depth_mm": 50, "frequency_khz": 2000}, 5),
}


@pytest.fixture(params=OTHERS, autouse=True)
def other(request):
    """Arguments of an environment that are not the default ones."""
    return OTHERS[request.param]


@pytest.mark.parametrize("task", WALKS)
def test_the_environment_is_as_gymnasium_wants_it(task, other):
    options, action = WALKS[task]
    env = gym.make(f"usbench/{task}", render_mode="rgb_array", **other)
    imaging = other["imaging"]
    assert env.observation_space.shape == (imaging.height_px, imaging.width_px, 1)
    observation, _ = env.reset(seed=3, options=options)
    assert observation in env.observation_space and observation.any()
    observation, *_ = env.step(action)
    assert observation in env.observation_space
    picture = env.render()
    assert picture.shape[0] == 580 and picture.shape[1] % 2 == 0 and picture.dtype == np.uint8


def test_all_of_the_checks_pass(other, monkeypatch):
    class Frames:
        def frame(self, pose):
            return np.full((other["imaging"].height_px, other["imaging"].width_px), 7, np.uint8)

    monkeypatch.setattr("usbench.envs.guidance.frame_store", lambda *_: Frames())
    check_env(gym.make("usbench/ProbePlane-v0", render_mode="rgb_array", **other).unwrapped)


def test_stacks_and_normalised_pixels_follow(other):
    env = NormalizeImage(ImageStack(gym.make("usbench/ProbePlane-v0", **other), 3))
    observation, _ = env.reset(seed=3)
    assert observation.shape == (other["imaging"].height_px, other["imaging"].width_px, 3)
    assert observation in env.observation_space and env.step(1)[0] in env.observation_space


def test_the_image_reward_is_best_where_the_object_is_in_the_middle(other):
    env = gym.make("usbench/ProbePlane-v0", reward="image", **other)
    rewards = {}
    for x_mm, angle_deg in ((0, 0), (15, 0), (0, 90)):
        env.reset(seed=0, options={"x_mm": x_mm, "angle_deg": angle_deg})
        rewards[x_mm, angle_deg] = env.step(0)[1]
    assert max(rewards, key=rewards.get) == (0, 0) and rewards[0, 0] > -0.15
    plain = env.unwrapped
    view = standard_view(plain.probe, plain.imaging)
    assert likeness(view, view, plain.imaging) == pytest.approx(1)
