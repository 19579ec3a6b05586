"""Agents that are told something beside the image: every algorithm learns, and senses and image are mixed."""

from dataclasses import replace
from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch
from gymnasium import spaces
from signs import Signs
from stable_baselines3.common.buffers import DictReplayBuffer
from stable_baselines3.common.vec_env import DummyVecEnv

from usbench.agents import zoo
from usbench.agents.dict_rollout import SliceableObservations
from usbench.agents.frame_buffer import FrameReplayBuffer
from usbench.agents.on_policy import A2C, PPO, TRPO
from usbench.agents.sensing_trunk import SensingTrunk
from usbench.agents.value_based.double_dqn import DoubleDQN
from usbench.agents.vpg import VPG

LEARNERS = [algo for algo, row in zoo.ZOO.items() if row.learns and not row.needs]
SMALL = {
    "vpg": {"n_steps": 16},
    "vpg-tuned": {"n_steps": 16},
    "a2c": {"n_steps": 16},
    "ppo": {"n_steps": 32, "batch_size": 16, "n_epochs": 2},
    "dqn": {"learning_starts": 16, "target_update_interval": 16, "train_freq": 4},
    "double_dqn": {"learning_starts": 16, "train_freq": 4, "batch_size": 16},
    "ppo_asymmetric": {"n_steps": 32, "batch_size": 16, "n_epochs": 2},
    "qrdqn": {"learning_starts": 16, "target_update_interval": 16},
    "trpo": {"n_steps": 32, "batch_size": 16, "sub_sampling_factor": 2},
    "recurrent_ppo": {"n_steps": 32, "batch_size": 16, "n_epochs": 2},
}
DICT = spaces.Dict(
    {"image": spaces.Box(-3, 3, (9, 4, 4), np.float32), "senses": spaces.Box(-1, 1, (3,), np.float32)}
)


class Opposites(gym.Env[dict[str, np.ndarray], int]):
    """The bright half of the image and the sense together, neither alone, say which action is right."""

    action_space = spaces.Discrete(2)

    def __init__(self) -> None:
        self._signs = Signs()
        sense = spaces.Box(-1, 1, (1,), np.float32)
        self.observation_space = spaces.Dict({"image": self._signs.observation_space, "senses": sense})

    def _told(self, image: np.ndarray) -> dict[str, np.ndarray]:
        self._turned = int(self.np_random.integers(2))
        return {"image": image, "senses": np.array([2.0 * self._turned - 1.0], np.float32)}

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        super().reset(seed=seed)
        image, info = self._signs.reset(seed=seed)
        return self._told(image), info

    def step(self, action: int) -> Any:
        image, reward, terminated, truncated, info = self._signs.step(int(action) ^ self._turned)
        return self._told(image), reward, terminated, truncated, info


def make(algo: str, seed: int = 3, **overrides: Any) -> Any:
    settings = zoo.hyperparameters(algo, "pp", SMALL[algo] | overrides)
    return zoo.make(algo, DummyVecEnv([Opposites]), seed, settings, device="cpu", verbose=0)


@pytest.mark.parametrize("algo", ["vpg", "a2c", "ppo", "dqn"])
def test_senses_add_no_hidden_layers_behind_the_trunk(algo: str) -> None:
    assert make(algo).policy.net_arch == []


def test_hidden_layers_of_ones_own_row_are_kept_with_senses(monkeypatch: pytest.MonkeyPatch) -> None:
    for policy in ("CnnPolicy", "MlpPolicy"):
        row = replace(zoo.ZOO["vpg"], policy=policy, policy_kwargs={"net_arch": [32]})
        monkeypatch.setitem(zoo.ZOO, "vpg", row)
        assert make("vpg").policy.net_arch == [32]


@pytest.mark.parametrize("cls", [VPG, A2C, PPO, TRPO, partial(DoubleDQN, buffer_size=10)])
def test_a_class_that_is_asked_for_dictionaries_alone_has_the_trunk_for_them(cls: Any) -> None:
    model = cls("MultiInputPolicy", DummyVecEnv([Opposites]), seed=0, device="cpu")
    assert any(isinstance(part, SensingTrunk) for part in model.policy.modules())
    assert model.predict(model.env.reset())[0].shape == (1,)


def weights(model: Any) -> torch.Tensor:
    return torch.cat([tensor.double().flatten() for tensor in model.policy.state_dict().values()])


@pytest.mark.parametrize("algo", LEARNERS)
def test_every_algorithm_learns_from_image_and_senses_and_repeats_its_bits(algo: str) -> None:
    model = make(algo)
    before = weights(model)
    assert any(isinstance(part, SensingTrunk) for part in model.policy.modules())
    assert not torch.equal(weights(model.learn(64)), before)
    assert model.num_timesteps == 64
    assert torch.equal(weights(model), weights(make(algo).learn(64)))


@pytest.mark.parametrize("algo", LEARNERS)
def test_both_parts_of_an_observation_count(algo: str) -> None:
    policy = make(algo).policy
    policy.set_training_mode(False)
    trunk = next(part for part in policy.modules() if isinstance(part, SensingTrunk))
    image, senses = torch.ones(2, 8, 8, 1), torch.tensor([[1.0], [-1.0]])
    with torch.no_grad():
        told_apart = trunk({"image": image, "senses": senses})
        seen_apart = trunk({"image": image * senses[:, :, None, None], "senses": senses[:1].repeat(2, 1)})
    assert not torch.allclose(*told_apart) and not torch.allclose(*seen_apart)


@pytest.mark.slow
@pytest.mark.parametrize("algo", ["ppo", "dqn"])
def test_what_only_both_together_tell_is_learned(algo: str) -> None:
    model = make(algo, learning_rate=1e-3).learn(3000)
    env, right = Opposites(), 0
    observation, _ = env.reset(seed=1)
    for _ in range(200):
        action, _ = model.predict(observation, deterministic=True)
        observation, reward, *_ = env.step(int(action))
        right += int(reward)
    assert right >= 180


def test_the_frame_buffer_samples_the_bits_of_sb3s_dict_buffer() -> None:
    generator = np.random.default_rng(0)
    ours = FrameReplayBuffer(50, DICT, spaces.Discrete(5), "cpu", n_envs=2)
    theirs = DictReplayBuffer(50, DICT, spaces.Discrete(5), "cpu", n_envs=2)
    for _ in range(60):
        first, then = (
            {
                "image": generator.uniform(-3, 3, (2, 9, 4, 4)).astype(np.float32),
                "senses": generator.uniform(-1, 1, (2, 3)).astype(np.float32),
            }
            for _ in range(2)
        )
        rest = generator.integers(5, size=2), generator.normal(size=2), np.zeros(2, bool), [{}, {}]
        ours.add(first, then, *rest)
        theirs.add(first, then, *rest)
    # Those of the 25 steps that it holds, and of the 10 that were overwritten since it was full last.
    assert ours.state()["senses"].shape == (35 * 2 * 2, 3)
    again = FrameReplayBuffer(50, DICT, spaces.Discrete(5), "cpu", n_envs=2)
    again.put_back(ours.state())
    samples = []
    for buffer in (ours, theirs, again):
        np.random.seed(1)
        samples.append(buffer.sample(16))
    for name in ("observations", "next_observations"):
        for part in ("image", "senses"):
            one, other, restored = (getattr(sample, name)[part].numpy() for sample in samples)
            np.testing.assert_array_equal(one, other)
            np.testing.assert_array_equal(one, restored)


def test_a_slice_of_observations_is_a_part_of_the_batch() -> None:
    batch = SliceableObservations({"image": torch.arange(6), "senses": -torch.arange(6)})
    assert batch[::4]["image"].tolist() == [0, 4] and batch[::4]["senses"].tolist() == [0, -4]
    assert batch["image"].shape == (6,)


def test_other_parts_than_image_and_senses_are_refused() -> None:
    other = spaces.Dict({"image": DICT["image"], "sound": DICT["senses"]})
    with pytest.raises(ValueError, match="must have the parts 'image' and 'senses', not 'image', 'sound'"):
        SensingTrunk(other)
