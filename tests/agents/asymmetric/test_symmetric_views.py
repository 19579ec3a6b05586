"""Rollouts in symmetric views: what of a step is transformed, and what belongs to it unchanged."""

import gymnasium as gym
import numpy as np
import pytest
import torch
from signs import Signs
from stable_baselines3.common.vec_env import DummyVecEnv
from symmetric import viewed

from usbench.agents import zoo
from usbench.agents.asymmetric.ppo import AsymmetricPPO
from usbench.agents.value_based.views import Views
from usbench.agents.vec_env import SB3VecEnv
from usbench.setting import Setting
from usbench.trials import knowledge
from usbench.trials.learning import make_agent

SMALL = {"n_steps": 64, "batch_size": 16, "n_epochs": 2}
TRACKED = Setting(task="pp-tracked", senses=("position", "heading", "actions"), n_frames=2)
UNTOLD = Setting(task="fp-random", n_frames=2)
both = pytest.mark.parametrize("setting", [TRACKED, UNTOLD], ids=["pp-tracked", "fp-random"])


@pytest.fixture(autouse=True)
def _quick(quick):
    pass


def model(setting=TRACKED, views=True):
    env = SB3VecEnv(setting.make_vec_env(4, autoreset_mode="SameStep"))
    env.seed(0)
    chosen = zoo.hyperparameters("ppo_asymmetric", setting.task, SMALL | {"symmetric_views": views})
    return make_agent(setting, "ppo_asymmetric", env, 0, chosen)


def filled(agent):
    """The model with a complete rollout, before it has learned from it."""
    _, callback = agent._setup_learn(64)
    assert agent.collect_rollouts(agent.env, callback, agent.rollout_buffer, agent.n_steps)
    agent.policy.set_training_mode(True)
    return agent


def steps_of(rollout):
    """Advantages, observations and actions of a rollout as it was, flattened as the samples are."""
    flat = rollout.swap_and_flatten
    seen = rollout.observations
    seen = {name: flat(one) for name, one in seen.items()} if isinstance(seen, dict) else flat(seen)
    return flat(rollout.advantages)[:, 0], seen, flat(rollout.actions)[:, 0], flat(rollout.states)


def one_of(seen, k):
    return {name: np.asarray(one[k]) for name, one in seen.items()} if isinstance(seen, dict) else seen[k]


def same(seen, other):
    pairs = [(seen[name], other[name]) for name in seen] if isinstance(seen, dict) else [(seen, other)]
    return all(np.array_equal(one, two) for one, two in pairs)


@both
def test_a_sample_is_a_view_of_its_step_with_the_steps_advantage_and_state(setting):
    symmetries, rollout = knowledge.symmetries(setting), filled(model(setting)).rollout_buffer
    advantages, seen, actions, states = steps_of(rollout)
    assert len(np.unique(advantages)) == len(advantages) == 64  # by which a sample is known
    met = []
    for batch in [*rollout.get(16), *rollout.get(16)]:
        for k, advantage in enumerate(batch.advantages.numpy()):
            (step,) = np.flatnonzero(advantages == advantage)
            shown = one_of(batch.observations.observations, k)
            views = [
                number
                for number in range(len(symmetries))
                if same(shown, viewed(symmetries, number, one_of(seen, step)))
                and symmetries.actions[number, int(actions[step])] == batch.actions[k, 0]
            ]
            assert views
            met.append((step, views))
            np.testing.assert_array_equal(batch.observations.states[k], states[step])
    # Several views are the same where a symmetry changes nothing.
    assert {views[0] for _, views in met if len(views) == 1} >= set(range(len(symmetries)))
    # The second time a step is seen in another view.
    assert dict(met[:64]) != dict(met[64:])


@both
def test_the_ratio_begins_at_1_or_at_the_importance_of_an_action_that_is_rarer_in_the_view(setting):
    agent = filled(model(setting))
    policy, rollout = agent.policy, agent.rollout_buffer
    np.testing.assert_array_equal(rollout.log_probs_in_views[..., 0], rollout.log_probs)
    as_they_were = dict(
        zip(rollout.swap_and_flatten(rollout.advantages)[:, 0], rollout.log_probs.T.flatten(), strict=True)
    )
    rarer = []
    for batch in rollout.get(16):
        with torch.no_grad():
            _, log_prob, _ = policy.evaluate_actions(batch.observations, batch.actions.flatten())
        drawn = torch.tensor([as_they_were[advantage] for advantage in batch.advantages.numpy()])
        ratio = (log_prob - batch.old_log_prob).exp()
        torch.testing.assert_close(ratio, (log_prob - drawn).exp().clamp(max=1))
        rarer.append((ratio < 0.999).numpy())
    # Both occur.
    assert 0 < np.concatenate(rarer).sum() < 64


def test_no_ratio_can_exceed_one_over_the_probability_of_the_drawn_action():
    agent = model()
    weights = agent.policy.action_net.weight
    with torch.no_grad():
        weights.mul_(10_000)  # a sharp policy, to which some viewed actions are all but impossible
        rollout = filled(agent).rollout_buffer
        assert rollout.log_probs_in_views.min() < -88.8  # e to the 88.8 is more than float32 holds
        weights.zero_()  # and one to which all actions are alike
        bound = np.exp(-rollout.log_probs.min())
        for batch in rollout.get(16):
            _, log_prob, _ = agent.policy.evaluate_actions(batch.observations, batch.actions.flatten())
            assert (log_prob - batch.old_log_prob).exp().max() <= bound


def test_old_log_probabilities_are_those_of_the_policy_that_acted():
    agent = filled(model())
    before = [batch.old_log_prob for batch in _in_order(agent.rollout_buffer)]
    agent.train()
    after = [batch.old_log_prob for batch in _in_order(agent.rollout_buffer)]
    assert all(torch.equal(one, other) for one, other in zip(before, after, strict=True))


def _in_order(rollout):
    """The samples of a rollout, drawn with the same generators each time."""
    np.random.seed(0)
    torch.manual_seed(0)
    return list(rollout.get(16))


def test_advantages_returns_and_values_are_those_without_views():
    viewed, plain = (filled(model(views=views)).rollout_buffer for views in (True, False))
    for name in ("advantages", "returns", "values", "log_probs", "states", "actions"):
        np.testing.assert_array_equal(getattr(viewed, name), getattr(plain, name), err_msg=name)
    assert plain.views is None and isinstance(viewed.views, Views)


def test_without_views_nothing_is_drawn_and_nothing_is_asked():
    rollout = filled(model(views=False)).rollout_buffer
    before = torch.get_rng_state()
    list(rollout.get(16))
    assert torch.equal(torch.get_rng_state(), before)
    assert not hasattr(rollout, "log_probs_in_views")


@both
def test_learns_in_views(setting):
    agent = model(setting)
    before = [parameter.detach().clone() for parameter in agent.policy.policy_parameters()]
    agent.learn(128)
    after = agent.policy.policy_parameters()
    assert all(torch.isfinite(parameter).all() for parameter in after)
    assert not all(torch.equal(one, other) for one, other in zip(before, after, strict=True))


def test_images_that_have_their_channels_first_are_refused():
    env = DummyVecEnv([lambda: gym.make("usbench/ProbePlane-v0")])
    with pytest.raises(ValueError, match="symmetries and shifts need images"):
        AsymmetricPPO(
            "CnnPolicy", env, symmetric_views=True, symmetries=knowledge.symmetries(Setting(task="pp-random"))
        )


def test_a_task_without_symmetries_is_learned_as_it_is():
    chosen = zoo.hyperparameters("ppo_asymmetric", "pp", SMALL | {"symmetric_views": True})
    agent = zoo.make("ppo_asymmetric", DummyVecEnv([Signs] * 4), 3, chosen, device="cpu")
    assert agent.learn(64).num_timesteps == 64
    assert agent.rollout_buffer.views is None
