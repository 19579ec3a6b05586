"""Every variant of the ablations is made and learns, and differs from the agent in what its title says."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import nn
from unseen_phantoms import agents
from unseen_phantoms.studies import ABLATIONS, SETTING, TASK

from usbench.agents.vec_env import SB3VecEnv
from usbench.setting import Setting
from usbench.trials import knowledge
from usbench.trials.learning import make_agent

# So small that a few steps make updates.
SMALL = {"learning_starts": 16, "train_freq": 4, "batch_size": 16, "buffer_size": 200}
SMALL_ROLLOUTS = {"n_steps": 32, "batch_size": 16, "n_epochs": 2}
SYMMETRIES = knowledge.symmetries(Setting(task=TASK, **SETTING))
STAY, LEFT, RIGHT, COUNTER_CLOCKWISE, CLOCKWISE = range(5)


def made(variant):
    """Return a small agent of a variant in four environments."""
    small = SMALL_ROLLOUTS if variant.algo == "ppo_asymmetric" else SMALL
    config = replace(variant, overrides={**variant.overrides, **small}).config(64, seed=0)
    setting = Setting.recorded(config)
    env = SB3VecEnv(setting.make_vec_env(4, autoreset_mode="SameStep"))
    return make_agent(setting, config.algo, env, 0, config.hyperparameters)


def named(title):
    (variant,) = [one for one in ABLATIONS if one.title == title]
    return made(variant)


def seen_by(agent, n=6):
    """Return observations that an agent of the study may be given."""
    generator = torch.Generator().manual_seed(0)
    return {
        name: torch.randn(n, *space.shape, generator=generator)
        for name, space in agent.observation_space.items()
    }


@pytest.mark.parametrize("variant", ABLATIONS, ids=lambda one: one.title)
def test_a_variant_learns(quick, variant):
    agent = made(variant)
    before = [parameter.detach().clone() for parameter in agent.policy.parameters()]
    agent.learn(48)
    after = list(agent.policy.parameters())
    assert all(torch.isfinite(parameter).all() for parameter in after)
    assert not all(torch.equal(one, other) for one, other in zip(before, after, strict=True))


def test_titles_are_unique_and_each_variant_differs_from_the_others():
    assert len({one.title for one in ABLATIONS}) == len(ABLATIONS)
    assert len({one.config(64, seed=0).hash for one in ABLATIONS}) == len(ABLATIONS)


@pytest.mark.parametrize(
    ("row", "mirrored", "signs", "actions"),
    [
        (agents.ANGLES_NEGATED, False, (1, -1, 1), [STAY, LEFT, RIGHT, CLOCKWISE, COUNTER_CLOCKWISE]),
        (agents.TURNED_MIRRORED, True, (1, -1, -1), [STAY, LEFT, RIGHT, COUNTER_CLOCKWISE, CLOCKWISE]),
        (agents.TURNED_X_NEGATED, False, (-1, -1, -1), [STAY, RIGHT, LEFT, COUNTER_CLOCKWISE, CLOCKWISE]),
    ],
)
def test_single_symmetries_are_what_their_names_say(row, mirrored, signs, actions):
    _, number = row.kwargs["numbers"]
    assert SYMMETRIES.mirrored[number] == mirrored
    # Of x, and of sine and cosine of the probe's angle.
    assert tuple(SYMMETRIES.signs[number, :3]) == signs
    assert SYMMETRIES.actions[number].tolist() == actions


def test_what_is_remembered_is_seen_in_the_chosen_views_and_the_network_sees_it_as_it_is(quick):
    agent = named("replay alone: turned about, picture mirrored")
    views, seen = agent.q_net.views, seen_by(agent)
    assert views.mirrored.tolist() == [False, True]
    with torch.no_grad():
        assert torch.equal(agent.q_net(seen), agent.q_net._dueling(seen))
        assert not torch.equal(agent.q_net(seen), named("as it is").q_net(seen))
    drawn = set(views.drawn(100).tolist())
    assert drawn == {0, 1}
    assert len(named("replay alone: all symmetries").q_net.views.mirrored) == 8


def test_the_network_alone_has_the_symmetries(quick):
    agent = named("network alone: all symmetries")
    seen, actions = seen_by(agent), torch.zeros(6, 1, dtype=torch.long)
    views = agent.q_net.views
    numbers = torch.arange(6) + 2
    with torch.no_grad():
        there = agent.q_net(views.observations(seen, numbers))
        torch.testing.assert_close(views.values_from(there, numbers), agent.q_net(seen))
    before, same, after = agent._viewed(seen, actions, seen)
    assert before is seen and after is seen and same is actions


def test_without_symmetries_there_are_no_views(quick):
    assert named("no symmetries").q_net.views is None
    assert named("no symmetries, shifts of 2 pixels").max_shift_px == 2


def test_trunks_have_the_norm_and_the_grid_that_they_are_named_after(quick):
    def norms(title):
        trunk = named(title).q_net.features_extractor.trunk
        return trunk.features_dim, [
            one.num_groups for one in trunk.modules() if isinstance(one, nn.GroupNorm)
        ]

    assert norms("as it is") == (720, [4] * 6)
    assert norms("layer norm") == (720, [1] * 6)
    assert norms("no norm") == (720, [])
    assert norms("one average over the picture") == (48, [4] * 6)
    paper = named("the paper's trunk").q_net.features_extractor.trunk
    assert paper.features_dim == np.prod((32, 22, 10))
