"""What a network learns from in a view: observations, actions and costs belong together."""

import numpy as np
import pytest
import symmetric
import torch
from pp_tracked import SETTING, SYMMETRIES, observations
from small_double_dqn import SMALL

from usbench.agents import zoo
from usbench.agents.vec_env import SB3VecEnv
from usbench.trials import knowledge


def made(algo, **more):
    env = SB3VecEnv(SETTING.make_vec_env(1, autoreset_mode="SameStep"))
    chosen = zoo.hyperparameters(algo, SETTING.task, SMALL)
    return zoo.make(algo, env, 0, chosen, device="cpu", symmetries=SYMMETRIES, **more)


def test_a_transition_is_seen_in_one_view_before_and_after_and_in_its_action(monkeypatch):
    agent = made("double_dqn")
    agent.max_shift_px = 0
    monkeypatch.setattr(agent.policy.q_net.views, "drawn", torch.arange)
    before, after, actions = observations(8, 1), observations(8, 2), torch.arange(8)[:, None] % 5
    seen, acted, following = agent._viewed(before, actions, after)
    for k in range(8):
        for given, found in ((before, seen), (after, following)):
            expected = symmetric.viewed(SYMMETRIES, k, {name: one[k].numpy() for name, one in given.items()})
            for name in expected:
                np.testing.assert_array_equal(found[name][k], expected[name])
        assert acted[k, 0] == SYMMETRIES.actions[k, k % 5]


def test_costs_move_with_the_actions_of_a_view(monkeypatch):
    agent = made("distilled", teacher=knowledge.teacher(SETTING))
    agent.max_shift_px = 0
    monkeypatch.setattr(agent.policy.q_net.views, "drawn", torch.arange)
    seen, costs = observations(8, 1), torch.rand(8, 5, generator=torch.Generator().manual_seed(3))
    monkeypatch.setattr(agent.replay_buffer, "advice", lambda n: (seen, costs))
    errors = []
    for k in range(8):
        one = symmetric.viewed(SYMMETRIES, k, {name: each[k].numpy() for name, each in seen.items()})
        with torch.no_grad():
            values = agent.q_net({name: torch.as_tensor(each.copy())[None] for name, each in one.items()})[0]
        # The action that `a` becomes in the view costs what `a` costs.
        errors += [(values[SYMMETRIES.actions[k, a]] + costs[k, a]) ** 2 for a in range(5)]
    assert agent._update(8) == pytest.approx(float(torch.stack(errors).mean()), rel=1e-4)


def test_observations_before_and_after_are_shifted():
    agent = made("double_dqn")
    agent.max_shift_px = 3
    torch.manual_seed(0)
    same = observations(64, 1)
    seen, _, following = agent._viewed(same, torch.zeros(64, 1, dtype=torch.long), same)
    plain = same["image"]
    for found in (seen, following):
        moved = [
            not any(torch.equal(one, other) for other in (plain[k], plain[k].flip(1)))
            for k, one in enumerate(found["image"])
        ]
        assert sum(moved) > 40
