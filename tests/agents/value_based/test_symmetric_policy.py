"""The symmetric policy: exact symmetry of its values, its greedy actions, and what it is after saving."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch
from gymnasium import spaces
from pp_tracked import SETTING, SYMMETRIES, observations
from small_double_dqn import SMALL, model
from stable_baselines3.common.vec_env import DummyVecEnv

from usbench.agents import adapting, zoo
from usbench.agents.value_based.double_dqn import DoubleDQN
from usbench.agents.value_based.symmetric_policy import SymmetricPolicy, SymmetricQNetwork
from usbench.watch.advice import Adviser


@pytest.mark.parametrize("number", range(8))
def test_symmetric_observations_have_symmetric_values(number):
    env = SimpleNamespace(
        observation_space=spaces.Dict(
            image=spaces.Box(-3, 3, (90, 40, 2), np.float32), senses=spaces.Box(-1, 1, (16,), np.float32)
        ),
        action_space=spaces.Discrete(5),
    )
    row = adapting.with_senses(zoo.entry("double_dqn"))
    cls, kwargs = (zoo._resolved(row.policy_kwargs[f"features_extractor_{x}"]) for x in ("class", "kwargs"))
    extractor = cls(env.observation_space, **kwargs)
    torch.manual_seed(0)
    network = SymmetricQNetwork(
        env.observation_space,
        env.action_space,
        features_extractor=extractor,
        features_dim=extractor.features_dim,
        net_arch=[],
        symmetries=SYMMETRIES,
    )
    seen = observations()
    numbers = torch.full((40,), number)
    with torch.no_grad():
        values = network(seen)
        there = network(network.views.observations(seen, numbers))
    assert values.std(dim=1).min() > 1e-4
    torch.testing.assert_close(network.views.values_from(there, numbers), values)


def test_values_are_advantages_around_a_value():
    network = model().q_net
    outputs = torch.tensor([[10.0, 1.0, 3.0]])
    network.q_net = torch.nn.Sequential(torch.nn.Flatten())
    network.extract_features = lambda obs, extractor: outputs
    torch.testing.assert_close(network(None), torch.tensor([[9.0, 11.0]]))


def test_greedy_actions_are_those_of_the_averaged_network():
    agent = model().learn(32)
    with torch.no_grad():
        for parameter in agent.q_net.q_net.parameters():
            parameter.mul_(-1.0)
    seen = torch.randn(16, *agent.observation_space.shape)
    actions, _ = agent.predict(seen.numpy(), deterministic=True)
    assert actions.tolist() == agent.q_net_target(seen).argmax(1).tolist()


def test_greedy_actions_can_follow_from_means_over_pictures_moved_sideways():
    agent = model(greedy_shift_px=2).learn(32)
    seen = np.random.default_rng(0).normal(size=(64, *agent.observation_space.shape)).astype(np.float32)
    padded = np.pad(seen, ((0, 0), (0, 0), (2, 2), (0, 0)), mode="edge")
    width = seen.shape[2]
    with torch.no_grad():
        # Both actions are good now and then.
        agent.q_net_target.q_net[-1].bias[1:] -= agent.q_net_target(torch.tensor(seen)).mean(0)
        values = [agent.q_net_target(torch.tensor(padded[:, :, k : k + width])).numpy() for k in range(5)]
    expected = np.mean(values, axis=0).argmax(1)
    assert agent.predict(seen, deterministic=True)[0].tolist() == expected.tolist()
    assert expected.tolist() != values[2].argmax(1).tolist()
    # Guide and replay show the same.
    adviser = Adviser(agent)
    assert [adviser.advise(one, {}, 1).best for one in seen] == expected.tolist()


def test_means_over_moved_pictures_leave_the_training_as_it_is(tmp_path):
    plain, averaged = model().learn(64), model(greedy_shift_px=2).learn(64)
    weights = zip(plain.policy.parameters(), averaged.policy.parameters(), strict=True)
    assert all(torch.equal(one, other) for one, other in weights)
    averaged.save(tmp_path / "model.zip")
    assert DoubleDQN.load(tmp_path / "model.zip").policy.greedy_shift_px == 2


def test_a_policy_that_was_saved_alone_acts_as_it_did(tmp_path):
    """What SB3 calls `model.policy.save`: a file for acting, without the algorithm."""
    env = DummyVecEnv([SETTING.make_env])
    chosen = zoo.hyperparameters("double_dqn", "pp-tracked", SMALL | {"greedy_shift_px": 1})
    policy = zoo.make("double_dqn", env, 3, chosen, device="cpu", symmetries=SYMMETRIES).policy
    policy.save(tmp_path / "policy.pt")
    loaded = SymmetricPolicy.load(tmp_path / "policy.pt", device="cpu")
    seen = {name: values.numpy() for name, values in observations(64).items()}
    expected = policy.predict(seen, deterministic=True)[0]
    assert loaded.predict(seen, deterministic=True)[0].tolist() == expected.tolist()
    assert (loaded.greedy_shift_px, len(loaded.q_net.views.mirrored)) == (1, len(SYMMETRIES))


def test_a_saved_policy_keeps_whether_its_views_are_canonical(tmp_path):
    space = spaces.Box(-3, 3, (90, 40, 2), np.float32)
    policy = SymmetricPolicy(space, spaces.Discrete(5), lambda left: 1e-3, net_arch=[4], canonical=False)
    policy.save(tmp_path / "policy.pt")
    assert SymmetricPolicy.load(tmp_path / "policy.pt", device="cpu").q_net.canonical is False
