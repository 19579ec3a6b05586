"""Others' training scripts on the registered ids: RL Baselines3 Zoo's, and loops as CleanRL writes them."""

import importlib.util
import itertools
import os
import re
import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import torch
from gymnasium.wrappers import RecordEpisodeStatistics

PAGE = Path(__file__).parents[2] / "docs" / "extending.md"


def block(language, word):
    """The code block of the page that contains `word`."""
    return next(
        code for code in re.findall(rf"```{language}\n(.*?)```", PAGE.read_text(), re.DOTALL) if word in code
    )


@pytest.mark.skipif(importlib.util.find_spec("rl_zoo3") is None, reason="needs pip install rl_zoo3")
@pytest.mark.parametrize("env_id", ["usbench/FocalPoint-v0", "usbench/ProbePlane-v0"])
def test_rl_zoo_trains_on_a_registered_id(tmp_path, env_id):
    (tmp_path / "ours.yml").write_text(block("yaml", "frame_stack").replace("usbench/ProbePlane-v0", env_id))
    # sitecustomize draws the frames, as simulating them would take minutes.
    (tmp_path / "sitecustomize.py").write_text(
        "from quick_trials import DrawnFrames\n"
        "from usbench.envs import guidance\n"
        "guidance.frame_store = lambda *_: DrawnFrames()\n"
    )
    paths = [
        str(tmp_path),
        str(Path(__file__).parents[1] / "support"),
        *filter(None, [os.environ.get("PYTHONPATH")]),
    ]
    options = {"--env": env_id, "--algo": "ppo", "--gym-packages": "usbench", "--conf-file": "ours.yml"}
    options |= {"-n": "128", "--eval-freq": "64", "--eval-episodes": "1", "--num-threads": "1"}
    done = subprocess.run(
        [sys.executable, "-m", "rl_zoo3.train", *itertools.chain(*options.items())],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    assert "total_timesteps | 128" in done.stdout
    assert list(tmp_path.glob("logs/ppo/*/best_model.zip"))


def made(env_id, number):
    """As every script of CleanRL makes its environments."""

    def thunk():
        env = RecordEpisodeStatistics(gym.make(env_id))
        env.action_space.seed(number)
        return env

    return thunk


@pytest.mark.parametrize("env_id", ["usbench:usbench/FocalPoint-v0", "usbench:usbench/ProbePlane-v0"])
def test_registered_ids_in_a_vector_as_cleanrl_makes_it(quick, env_id):
    # By "module:id", since CleanRL's scripts import no package of environments.
    envs = gym.vector.SyncVectorEnv([made(env_id, number) for number in range(3)])
    assert isinstance(envs.single_action_space, gym.spaces.Discrete)
    assert envs.single_observation_space.shape == (90, 40, 1)
    observations, _ = envs.reset(seed=1)
    ended = []
    for _ in range(40):
        assert observations.shape == (3, 90, 40, 1) and observations.dtype == np.uint8
        observations, rewards, terminations, truncations, infos = envs.step(envs.action_space.sample())
        assert rewards.shape == (3,) and not terminations.any()
        if truncations.any():
            ended.append((infos["episode"]["l"].tolist(), infos["_episode"].tolist()))
    # 16 steps, one that only resets, and again.
    assert ended == [([16, 16, 16], [True] * 3)] * 2


def test_a_flat_id_takes_cleanrls_networks(quick, monkeypatch, tmp_path):
    """The rollout and the loss of its ppo.py: fully connected layers, tensors of (steps, environments)."""
    (tmp_path / "flat.py").write_text(block("python", "FlattenObservation"))
    monkeypatch.syspath_prepend(str(tmp_path))
    envs = gym.vector.SyncVectorEnv([made("flat:FlatProbePlane-v0", number) for number in range(2)])
    try:
        shape = envs.single_observation_space.shape
        actor = torch.nn.Linear(np.array(shape).prod(), envs.single_action_space.n)
        observations = torch.zeros((20, 2, *shape))
        actions, rewards, dones = torch.zeros((3, 20, 2))
        seen, done = torch.Tensor(envs.reset(seed=1)[0]), torch.zeros(2)
        for step in range(20):
            observations[step], dones[step] = seen, done
            with torch.no_grad():
                actions[step] = action = torch.distributions.Categorical(logits=actor(seen)).sample()
            seen, reward, terminations, truncations, _ = envs.step(action.cpu().numpy())
            rewards[step] = torch.tensor(reward).view(-1)
            seen, done = torch.Tensor(seen), torch.Tensor(np.logical_or(terminations, truncations))
        log_probs = torch.distributions.Categorical(logits=actor(observations)).log_prob(actions.long())
        (-log_probs * rewards).mean().backward()
    finally:
        gym.registry.pop("FlatProbePlane-v0", None)
        sys.modules.pop("flat", None)
    assert shape == (90 * 40 * 4,)
    assert dones.nonzero()[:, 0].tolist() == [16, 16]
    assert float(observations.abs().max()) < 5  # normalised
    assert actor.weight.grad.norm() > 0
