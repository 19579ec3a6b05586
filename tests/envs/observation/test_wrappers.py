"""Stacking and normalization: what an agent sees, and that buffers may keep it."""

import pickle

import gymnasium as gym
import numpy as np
import pytest

import usbench  # noqa: F401  (registers the ids)
from usbench.envs.bmode import Imaging
from usbench.envs.frames import frame_store
from usbench.envs.observation.wrappers import MEAN, STD, ImageStack, NormalizeImage
from usbench.envs.phantom import Phantom
from usbench.envs.probe import LinearArray
from usbench.envs.tasks.focal_point import FOCAL_POINT
from usbench.envs.tasks.probe_plane import PROBE_PLANE


class CountingEnv(gym.Env):
    """Images that tell how many steps were done, in one buffer that is written again and again."""

    def __init__(self, channels=1):
        self.observation_space = gym.spaces.Box(0, 255, (90, 40, channels), np.uint8)
        self.action_space = gym.spaces.Discrete(5)
        self.count = 0

    def _image(self):
        return np.full(self.observation_space.shape, self.count % 256, np.uint8)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.count = 10
        return self._image(), {}

    def step(self, action):
        self.count += 1
        return self._image(), 0.0, False, self.count == 16, {}


def wrapped(n_frames=4, mean=10.0, std=2.0):
    return NormalizeImage(ImageStack(CountingEnv(), n_frames), mean, std)


def test_the_stack_repeats_the_first_frame_and_ends_with_the_newest():
    env = ImageStack(CountingEnv(), 4)
    assert env.observation_space == gym.spaces.Box(0, 255, (90, 40, 4), np.uint8)
    first, _ = env.reset()
    seen = [first] + [env.step(0)[0] for _ in range(5)]
    assert all(stack.shape == (90, 40, 4) and stack.dtype == np.uint8 for stack in seen)
    assert [stack[0, 0].tolist() for stack in seen] == [
        [10, 10, 10, 10],
        [10, 10, 10, 11],
        [10, 10, 11, 12],
        [10, 11, 12, 13],
        [11, 12, 13, 14],
        [12, 13, 14, 15],
    ]
    assert env.reset()[0][5, 5].tolist() == [10] * 4


def test_images_with_several_channels_stay_together():
    env = ImageStack(CountingEnv(channels=3), 2)
    env.reset()
    assert env.step(0)[0][0, 0].tolist() == [10, 10, 10, 11, 11, 11]


def test_a_stack_that_was_handed_out_never_changes():
    env = ImageStack(CountingEnv(), 4)
    kept = [env.reset()[0]]
    for _ in range(5):
        kept.append(env.step(0)[0])
    kept[-1][...] = 255
    following = env.step(0)[0]
    assert following[0, 0].tolist() == [13, 14, 15, 16]
    assert [stack[0, 0, -1] for stack in kept[:-1]] == [10, 11, 12, 13, 14]


def test_the_stack_keeps_no_more_frames_than_it_shows():
    env = ImageStack(CountingEnv(), 4)
    env.reset()
    for _ in range(1_000):
        env.step(0)
    assert len(env._last) == 4


def test_normalization_is_pixel_minus_mean_over_std():
    env = wrapped()
    assert env.observation_space.dtype == np.float32
    assert env.observation_space.low.min() == -5 and env.observation_space.high.max() == 122.5
    assert env.observation_space.shape == (90, 40, 4)
    observation, _ = env.reset()
    assert observation.dtype == np.float32 and np.all(observation == 0)
    for _ in range(2):
        observation = env.step(0)[0]
    assert observation[0, 0].tolist() == [0, 0, 0.5, 1]
    assert env.observation_space.contains(observation)


def test_white_and_black_lie_in_the_space_at_the_default_constants():
    env = NormalizeImage(CountingEnv())
    for level in (0, 255):
        image = np.full((90, 40, 1), level, np.uint8)
        assert env.observation_space.contains(env.observation(image))


def mean_and_std(poses):
    """Return mean and standard deviation of all pixels in the frames from `poses`."""
    store = frame_store(Phantom(), LinearArray(), Imaging())
    store.prepare(poses)
    pixels = np.stack([store.frame(pose) for pose in poses]).astype(np.float64)
    return pixels.mean(), pixels.std()


def test_the_default_constants_fit_a_sample_of_the_frames():
    # At two focal depths, each of which takes seconds, and in every sixth plane.
    mean, std = mean_and_std([*FOCAL_POINT.states[::80], *PROBE_PLANE.states[::45]])
    assert (mean, std) == pytest.approx((MEAN, STD), abs=6)


@pytest.mark.slow
def test_the_default_constants_are_those_of_all_frames_of_both_tasks():
    mean, std = mean_and_std([*FOCAL_POINT.states, *PROBE_PLANE.states])
    assert (mean, std) == pytest.approx((MEAN, STD), abs=0.5)


def test_under_gymnasium_vector_environments():
    for vector_class in (gym.vector.SyncVectorEnv, gym.vector.AsyncVectorEnv):
        vector = vector_class([wrapped] * 2)
        try:
            observations, _ = vector.reset(seed=0)
            assert observations.shape == (2, 90, 40, 4) and observations.dtype == np.float32
            for _ in range(6):
                observations, *_, truncations, _ = vector.step(np.array([0, 0]))
            assert observations[1, 0, 0].tolist() == [1.5, 2, 2.5, 3] and truncations.all()
            observations, *_ = vector.step(np.array([0, 0]))
            assert np.all(observations == 0)  # the next episode starts anew
        finally:
            vector.close()


def test_under_sb3():
    from stable_baselines3.common.env_checker import check_env
    from stable_baselines3.common.vec_env import DummyVecEnv

    check_env(ImageStack(CountingEnv()))
    vector = DummyVecEnv([wrapped] * 2)
    vector.reset()
    for _ in range(6):
        observations, _, dones, infos = vector.step(np.array([0, 0]))
    assert dones.all() and np.all(observations == 0)
    assert infos[0]["terminal_observation"][0, 0].tolist() == [1.5, 2, 2.5, 3]


def test_wrapped_environments_pickle_and_are_made_again_from_their_spec():
    env = gym.make("usbench/FocalPoint-v0", noise=0.25)
    env = NormalizeImage(ImageStack(env, 2), mean=100.0, std=50.0)
    again = gym.make(env.spec)
    assert again.observation_space == env.observation_space
    assert again.unwrapped.noise == 0.25
    twin = wrapped()
    twin.reset()
    twin.step(0)
    copy = pickle.loads(pickle.dumps(twin))
    np.testing.assert_array_equal(copy.step(0)[0], twin.step(0)[0])


@pytest.mark.parametrize(
    ("wrap", "error", "message"),
    [
        (lambda env: ImageStack(env, 0), ValueError, "n_frames must be a whole number from 1, not 0"),
        (lambda env: ImageStack(env, 1.5), ValueError, "n_frames must be a whole number from 1, not 1.5"),
        (lambda env: ImageStack(env, "4"), TypeError, "n_frames must be a whole number from 1, not '4'"),
        (lambda env: ImageStack(NormalizeImage(env)), TypeError, "ImageStack needs .* uint8 images"),
        (lambda env: NormalizeImage(NormalizeImage(env)), TypeError, "NormalizeImage needs .* uint8 images"),
        (lambda env: NormalizeImage(env, std=0), ValueError, "std must be a positive number, not 0"),
        (lambda env: NormalizeImage(env, std=-1.0), ValueError, "std must be a positive number, not -1.0"),
        (
            lambda env: NormalizeImage(env, mean=float("nan")),
            ValueError,
            "mean must be a finite number, not nan",
        ),
        (lambda env: NormalizeImage(env, mean="0"), TypeError, "mean must be a finite number, not '0'"),
        (
            lambda env: NormalizeImage(env, std=1e-50),
            ValueError,
            "mean and std must make finite 32-bit numbers of the grey levels 0 to 255, not 46.5 and 1e-50",
        ),
        (lambda env: NormalizeImage(env, std=1e-40), ValueError, "finite 32-bit .*, not 46.5 and 1e-40"),
        (lambda env: NormalizeImage(env, std=1e39), ValueError, "finite 32-bit .*, not 46.5 and 1e.39"),
        (lambda env: NormalizeImage(env, mean=1e39), ValueError, "finite 32-bit .*, not 1e.39 and 52.9"),
        (lambda env: NormalizeImage(env, std=True), TypeError, "std must be a positive number, not True"),
    ],
)
def test_bad_arguments_are_refused(wrap, error, message):
    with pytest.raises(error, match=message):
        wrap(CountingEnv())
