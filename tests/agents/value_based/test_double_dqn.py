"""Double DQN: its target by hand, its learning rate and exploration, and that it learns."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch
from signs import Signs
from small_double_dqn import SMALL, model
from stable_baselines3.common.buffers import ReplayBufferSamples
from stable_baselines3.common.vec_env import DummyVecEnv

from usbench.agents import zoo
from usbench.agents.value_based.double_dqn import DoubleDQN
from usbench.agents.vec_env import SB3VecEnv
from usbench.records import Trial
from usbench.setting import Setting
from usbench.trials import knowledge
from usbench.trials.configuration import resolve
from usbench.trials.runner import run_trial


def test_target_is_valued_by_the_target_network_for_the_other_networks_action(monkeypatch):
    """Van Hasselt et al. (2016), Eq. 4, with a return of several steps."""
    agent = model()
    seen = torch.zeros(2, *agent.observation_space.shape)
    batch = ReplayBufferSamples(
        observations=seen,
        actions=torch.tensor([[0], [1]]),
        next_observations=seen,
        dones=torch.tensor([[0.0], [1.0]]),
        rewards=torch.tensor([[2.0], [3.0]]),
        discounts=torch.tensor([[0.729], [0.729]]),
    )
    found = []
    monkeypatch.setattr(agent, "replay_buffer", SimpleNamespace(sample=lambda n, env: batch))
    monkeypatch.setattr(
        "torch.nn.functional.smooth_l1_loss",
        lambda current, target: found.append((current, target)) or (current - target).square().mean(),
    )
    with torch.no_grad():
        for parameter in agent.q_net_target.q_net.parameters():
            parameter.copy_(torch.randn_like(parameter))
        best = agent.q_net(seen).argmax(1, keepdim=True)
        values = agent.q_net_target(seen).gather(1, best)
        before = agent.q_net(seen)
    agent._update(2)
    current, target = found[0]
    torch.testing.assert_close(target, torch.tensor([[2.0 + 0.729 * float(values[0])], [3.0]]))
    torch.testing.assert_close(current, before.gather(1, batch.actions))


def test_learning_rate_falls_in_a_line():
    agent = model(learning_rate=1e-2, final_learning_rate=1e-3)
    assert [agent.lr_schedule(left) for left in (1.0, 0.5, 0.0)] == pytest.approx([1e-2, 5.5e-3, 1e-3])
    agent.learn(64)
    assert agent.policy.optimizer.param_groups[0]["lr"] < 2e-3


def test_each_environment_tosses_a_coin_of_its_own():
    agent = model(n_envs=8).learn(32)
    seen = np.repeat(agent._last_obs[:1], 400, axis=0)
    agent.exploration_rate = 0.5
    np.random.seed(0)
    greedy = agent.policy.q_net(torch.as_tensor(seen)).argmax(1).numpy()
    actions, _ = agent.predict(seen)
    # Half of them explore, and half of those by chance do what the network says.
    assert 50 < (actions != greedy).sum() < 150
    one, _ = agent.predict(seen[0])
    assert np.shape(one) == ()


def test_class_makes_models_without_the_table():
    agent = DoubleDQN("MlpPolicy", DummyVecEnv([Signs]), seed=0, learning_starts=8, buffer_size=100)
    assert agent.learn(16).num_timesteps == 16


@pytest.mark.parametrize("task", ["pp-tracked", "exam-tracked", "fp-random"])
def test_learns_on_every_kind_of_task_with_its_symmetries(task):
    setting = Setting(task=task, n_frames=2)
    env = SB3VecEnv(setting.make_vec_env(4, autoreset_mode="SameStep"))
    for one in env.env.unwrapped.envs:
        one.is_watched = False
    chosen = zoo.hyperparameters("double_dqn", task, SMALL)
    agent = zoo.make("double_dqn", env, 0, chosen, device="cpu", symmetries=knowledge.symmetries(setting))
    before = torch.cat([tensor.flatten() for tensor in agent.q_net.parameters()]).detach().clone()
    agent.learn(128)
    after = torch.cat([tensor.flatten() for tensor in agent.q_net.parameters()])
    assert torch.isfinite(after).all() and not torch.equal(before, after)
    assert len(agent.policy.q_net.views.mirrored) == len(knowledge.symmetries(setting))


@pytest.mark.slow
def test_learns_a_plane_of_which_the_speckle_alone_tells_sides_apart(tmp_path):
    """In the views of drawn phantoms, in which both sides look alike, it had 0.2 after 16 064 steps."""
    trial = Trial.read(run_trial(resolve("double_dqn", "pp", steps=6400), tmp_path).folder)
    assert trial.last_evaluation(deterministic=True)["normalized_score"].mean() > 0.5
