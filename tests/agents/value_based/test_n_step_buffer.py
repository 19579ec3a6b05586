"""The n-step buffer against SB3's own, and by hand where SB3 has none: dictionaries, ends of episodes."""

import numpy as np
import pytest
import torch
from gymnasium import spaces
from stable_baselines3.common.buffers import NStepReplayBuffer

from usbench.agents.value_based.n_step_buffer import NStepFrameBuffer

STACKS = spaces.Box(-1.0, 2.0, (9, 4, 2), np.float32)
DICT = spaces.Dict({"image": STACKS, "senses": spaces.Box(-1, 1, (3,), np.float32)})
ACTIONS = spaces.Discrete(5)
RETURNS = {"n_steps": 3, "gamma": 0.5}


def grey(generator, *shape):
    """Values of the 256 grey levels from -1 to 2, as wrappers give them."""
    return (generator.integers(0, 256, shape).astype(np.float32) - np.float32(85)) / np.float32(85)


def filled(buffer, n, n_envs=1):
    generator = np.random.default_rng(0)
    for _ in range(n):
        stacks = grey(generator, 2, n_envs, 9, 4, 2)
        action, reward = generator.integers(5, size=n_envs), generator.normal(size=n_envs)
        truncated = generator.random(n_envs) < 0.2
        infos = [{"TimeLimit.truncated": bool(one)} for one in truncated]
        buffer.add(*stacks, action, reward, truncated | (generator.random(n_envs) < 0.1), infos)
    return buffer


def sampled(buffer, seed=1):
    np.random.seed(seed)
    return buffer.sample(64)


@pytest.mark.parametrize(("n", "n_envs"), [(20, 1), (70, 1), (130, 1), (40, 3)])
def test_samples_have_the_bits_of_sb3s_n_step_buffer(n, n_envs):
    ours, theirs = (
        filled(kind(50, STACKS, ACTIONS, "cpu", n_envs=n_envs, **RETURNS), n, n_envs)
        for kind in (NStepFrameBuffer, NStepReplayBuffer)
    )
    for one, other in zip(sampled(ours), sampled(theirs), strict=True):
        assert one.dtype == other.dtype
        torch.testing.assert_close(one, other, rtol=0, atol=0)


def one_env(rewards, dones, truncations):
    """A buffer of dictionaries of one environment whose k-th observation has the sense k / 100."""
    buffer = NStepFrameBuffer(20, DICT, ACTIONS, "cpu", **RETURNS)
    image = np.zeros((1, 9, 4, 2), np.float32) - 1
    for k, (reward, done, truncated) in enumerate(zip(rewards, dones, truncations, strict=True)):
        seen, following = (
            {"image": image, "senses": np.full((1, 3), one / 100, np.float32)} for one in (k, k + 1)
        )
        info = {"TimeLimit.truncated": bool(truncated)}
        buffer.add(seen, following, np.array([k % 5]), np.array([reward]), np.array([done]), [info])
    return buffer


def test_returns_of_dictionaries_end_where_episodes_end():
    buffer = one_env([1, 2, 4, 8, 16, 32, 64], [0, 0, 1, 0, 1, 0, 0], [0, 0, 1, 0, 0, 0, 0])
    batch = buffer._get_samples(np.arange(7))
    # Sums of up to three rewards, halved from step to step; the last two have too few after them.
    expected = [1 + 1 + 1, 2 + 2, 4, 8 + 8, 16, 32 + 32, 64]
    assert batch.rewards.flatten().tolist() == expected
    assert batch.discounts.flatten().tolist() == [0.125, 0.25, 0.5, 0.25, 0.5, 0.25, 0.5]
    # Truncated at step 2: the value counts. Terminated at step 4: nothing follows.
    assert batch.dones.flatten().tolist() == [0, 0, 0, 1, 1, 0, 0]
    followed = (batch.next_observations["senses"][:, 0] * 100).round().tolist()
    assert followed == [3, 3, 3, 5, 5, 7, 7]
    assert batch.actions.flatten().tolist() == [0, 1, 2, 3, 4, 0, 1]


def test_returns_do_not_run_from_the_newest_step_into_the_oldest():
    buffer = one_env(range(25), [0] * 25, [0] * 25)
    assert buffer.full
    batch = buffer._get_samples(np.array([4]))  # the newest of 25 in 20 places
    assert batch.rewards.item() == 24
    assert batch.discounts.item() == 0.5


def test_buffer_put_back_samples_the_same():
    first = filled(NStepFrameBuffer(50, STACKS, ACTIONS, "cpu", n_envs=3, **RETURNS), 40, 3)
    again = NStepFrameBuffer(50, STACKS, ACTIONS, "cpu", n_envs=3, **RETURNS)
    again.put_back(first.state())
    for buffer in (first, again):
        filled(buffer, 7, 3)
    for one, other in zip(sampled(first), sampled(again), strict=True):
        torch.testing.assert_close(one, other, rtol=0, atol=0)


def test_a_pixel_takes_a_byte():
    buffer = filled(NStepFrameBuffer(500, STACKS, ACTIONS, "cpu", **RETURNS), 200)
    assert buffer._frames.arrays.nbytes == 4 * 200 * 9 * 4


def test_images_of_any_values_keep_their_bits_from_the_first_that_is_not_grey():
    buffer = NStepFrameBuffer(500, STACKS, ACTIONS, "cpu", **RETURNS)
    generator = np.random.default_rng(1)
    stacks = [grey(generator, 2, 1, 9, 4, 2), generator.normal(size=(2, 1, 9, 4, 2)).astype(np.float32)]
    for pair in stacks * 2:
        buffer.add(*pair, np.zeros(1), np.zeros(1), np.ones(1), [{}])
    batch = buffer._get_samples(np.arange(4))
    np.testing.assert_array_equal(batch.observations, np.concatenate([pair[0] for pair in stacks * 2]))
    again = NStepFrameBuffer(500, STACKS, ACTIONS, "cpu", **RETURNS)
    again.put_back(buffer.state())
    np.testing.assert_array_equal(again._get_samples(np.arange(4)).observations, batch.observations)


OTHERS = {
    "float64": (spaces.Box(-1, 1, (9, 4, 2), np.float64), lambda generator: generator.uniform(-1, 1)),
    "float16": (spaces.Box(-1, 1, (9, 4, 2), np.float16), lambda generator: generator.uniform(-1, 1)),
    "bytes": (spaces.Box(0, 255, (9, 4, 2), np.uint8), lambda generator: generator.integers(0, 256)),
    "no bounds": (spaces.Box(-np.inf, np.inf, (9, 4, 2), np.float32), lambda generator: generator.normal()),
    "bounds that are equal": (spaces.Box(0, 0, (9, 4, 2), np.float32), lambda generator: 0.0),
    "zeros of both signs": (STACKS, lambda generator: generator.choice([0.0, -0.0])),
}


@pytest.mark.parametrize(("space", "value"), OTHERS.values(), ids=OTHERS)
def test_images_of_every_kind_keep_type_and_bits(space, value):
    generator = np.random.default_rng(2)
    seen = [np.full((1, *space.shape), value(generator), space.dtype) for _ in range(9)]
    seen += [np.vectorize(lambda _: value(generator))(one).astype(space.dtype) for one in seen]
    buffer = NStepFrameBuffer(50, space, ACTIONS, "cpu", **RETURNS)
    for one in seen:
        buffer.add(one, one, np.zeros(1), np.zeros(1), np.zeros(1), [{}])
    again = NStepFrameBuffer(50, space, ACTIONS, "cpu", **RETURNS)
    again.put_back(buffer.state())
    for each in (buffer, again):
        found = each._get_samples(np.arange(len(seen))).observations.numpy()
        assert found.dtype == space.dtype
        assert found.tobytes() == np.concatenate(seen).tobytes()
