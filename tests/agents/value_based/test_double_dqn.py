"""Double DQN: its target by hand, exact symmetry of its values, and views, shifts and coins of their own."""

from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest
import symmetric
import torch
from gymnasium import spaces
from signs import Signs
from stable_baselines3.common.buffers import ReplayBufferSamples
from stable_baselines3.common.vec_env import DummyVecEnv

from usbench.agents import adapting, zoo
from usbench.agents.value_based.double_dqn import DoubleDQN
from usbench.agents.value_based.grid_trunk import GridTrunk
from usbench.agents.value_based.symmetric_policy import SymmetricPolicy, SymmetricQNetwork
from usbench.agents.value_based.views import Views, shifted
from usbench.agents.vec_env import SB3VecEnv
from usbench.records import Trial
from usbench.setting import Setting
from usbench.trials.configuration import resolve
from usbench.trials.runner import run_trial

SETTING = Setting(task="pp-tracked", senses=("position", "heading", "actions"), n_frames=2)
SYMMETRIES = SETTING.symmetries()
SMALL = {"learning_starts": 16, "train_freq": 4, "batch_size": 16, "buffer_size": 1000}


def observations(n=40, seed=0):
    generator = torch.Generator().manual_seed(seed)
    images = torch.randn(n, 90, 40, 2, generator=generator)
    senses = torch.randn(n, 2 * SYMMETRIES.sources.shape[1], generator=generator)
    return {"image": images, "senses": senses}


def model(n_envs=1, **settings):
    env = DummyVecEnv([Signs] * n_envs)
    chosen = zoo.hyperparameters("double_dqn", "pp", SMALL | settings)
    return zoo.make("double_dqn", env, 3, chosen, device="cpu")


def test_views_of_batches_are_those_of_the_symmetries():
    views, seen = Views(SYMMETRIES), observations(8)
    numbers = torch.arange(8)
    viewed = views.observations(seen, numbers)
    for k in range(8):
        one = {name: values[k].numpy() for name, values in seen.items()}
        expected = symmetric.viewed(SYMMETRIES, k, one)
        np.testing.assert_array_equal(viewed["image"][k], expected["image"])
        np.testing.assert_array_equal(viewed["senses"][k], expected["senses"])
    actions = torch.arange(8)[:, None] % 5
    expected = [SYMMETRIES.actions[k, k % 5] for k in range(8)]
    assert views.actions_in(actions, numbers).flatten().tolist() == expected
    assert len(views.state_dict()) == 0


def test_canonical_views_have_no_negative_coordinate():
    views, seen = Views(SYMMETRIES), observations()
    viewed = views.observations(seen, views.canonical(seen))
    assert (viewed["senses"].view(-1, 2, 8)[:, -1, :3] >= 0).all()


@pytest.mark.parametrize(
    ("task", "senses"),
    [("pp-random", ("actions",)), ("pp-random", ()), ("fp-random", ()), ("exam-random", ("actions",))],
)
def test_without_coordinates_all_views_of_an_observation_have_one_canonical_view(task, senses):
    setting = Setting(task=task, senses=senses, n_frames=4)
    symmetries, generator = setting.symmetries(), torch.Generator().manual_seed(0)
    views, n_actions = Views(symmetries), len(setting.guidance.actions)
    seen = torch.randn(60, 90, 40, 4, generator=generator)
    if senses:
        acted = torch.randint(n_actions, (60, 4), generator=generator)
        told = torch.nn.functional.one_hot(acted, n_actions).float().flatten(1)
        told[:10, :n_actions] = 0  # before the first action
        seen = {"image": seen, "senses": told}
    canonical = views.observations(seen, views.canonical(seen))
    for number in range(len(symmetries)):
        viewed = views.observations(seen, torch.full((60,), number))
        torch.testing.assert_close(
            views.observations(viewed, views.canonical(viewed)), canonical, rtol=0, atol=0
        )


def test_the_last_move_of_each_kind_is_the_first_of_its_two_actions():
    views = Views(Setting(task="pp-random", senses=("actions",), n_frames=3).symmetries())
    # Actions 1 and 2 move left and right, 3 and 4 rotate; 0 stays.
    acted = torch.tensor([[1, 4, 2], [3, 4, 0], [4, 3, 2], [0, 0, 0]])
    told = torch.nn.functional.one_hot(acted, 5).float().flatten(1)
    seen = {"image": torch.zeros(4, 90, 40, 3), "senses": told}
    found = views.observations(seen, views.canonical(seen))["senses"].view(4, 3, 5).argmax(2)
    assert found.tolist() == [[2, 3, 1], [4, 3, 0], [4, 3, 1], [0, 0, 0]]


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


@pytest.mark.parametrize(
    ("task", "senses"), [("fp-random", ("focus",)), ("exam-random", ("focus", "actions"))]
)
def test_the_focus_alone_tells_no_view_from_another(task, senses):
    setting = Setting(task=task, senses=senses)
    views = Views(setting.symmetries())
    images = torch.randn(1, 90, 40, 1, generator=torch.Generator().manual_seed(0))
    told = torch.zeros(2, views.sources.shape[1])
    seen = {"image": torch.cat([images, images.flip(2)]), "senses": told}
    first, second = views.canonical(seen).tolist()
    assert views.mirrored[first] != views.mirrored[second]


@pytest.mark.parametrize(
    "settings", [{"symmetries": SYMMETRIES}, {"max_shift_px": 2}, {"greedy_shift_px": 2}]
)
def test_images_with_channels_in_front_have_no_views_and_shifts(settings):
    class Transposed(gym.Env):
        observation_space, action_space = spaces.Box(0, 255, (1, 40, 30), np.uint8), spaces.Discrete(5)

    with pytest.raises(ValueError, match="need images .height, width, channels.*NormalizeImage"):
        DoubleDQN("CnnPolicy", DummyVecEnv([Transposed]), buffer_size=10, **settings)


def test_arguments_of_the_buffer_leave_its_returns_as_they_are():
    given = {"handle_timeout_termination": True}
    env = DummyVecEnv([Signs])
    agent = DoubleDQN("MlpPolicy", env, gamma=0.5, return_steps=2, buffer_size=10, replay_buffer_kwargs=given)
    assert (agent.replay_buffer.n_steps, agent.replay_buffer.gamma) == (2, 0.5)
    assert given == {"handle_timeout_termination": True}


@pytest.mark.parametrize(
    ("name", "value", "error", "words"),
    [
        ("gamma", 1.5, ValueError, r"gamma must be a number in \(0, 1\], not 1.5."),
        ("return_steps", 0, ValueError, r"return_steps must be a whole number in \[1, 100\], not 0."),
        ("return_steps", -2, ValueError, "return_steps"),
        ("return_steps", 2.5, TypeError, r"return_steps must be a whole number in \[1, 100\], not 2.5."),
        ("max_shift_px", -1, ValueError, r"max_shift_px must be a whole number in \[0, 100\], not -1."),
        ("greedy_shift_px", -1, ValueError, r"greedy_shift_px must be a whole number in \[0, 10\], not -1."),
        ("learning_rate", -1.0, ValueError, "learning_rate must be"),
        ("final_learning_rate", float("nan"), ValueError, "final_learning_rate must be"),
    ],
)
def test_refuses(name, value, error, words):
    with pytest.raises(error, match=f"^{words}"):
        DoubleDQN("MlpPolicy", DummyVecEnv([Signs]), buffer_size=10, **{name: value})


def test_what_load_is_given_reaches_buffer_and_policy(tmp_path):
    agent = model(greedy_shift_px=2, return_steps=3)
    agent.save(tmp_path / "model.zip")
    given = {"gamma": 0.5, "return_steps": 1, "greedy_shift_px": 0}
    loaded = DoubleDQN.load(tmp_path / "model.zip", device="cpu", **given)
    assert (loaded.replay_buffer.gamma, loaded.replay_buffer.n_steps) == (0.5, 1)
    assert loaded.policy.greedy_shift_px == 0
    again = DoubleDQN.load(tmp_path / "model.zip", device="cpu")
    assert (again.replay_buffer.gamma, again.replay_buffer.n_steps) == (agent.gamma, 3)
    assert again.policy.greedy_shift_px == 2
    with pytest.raises(ValueError, match="return_steps must be"):
        DoubleDQN.load(tmp_path / "model.zip", device="cpu", return_steps=0)


def test_arguments_of_buffer_and_policy_win_also_after_load(tmp_path):
    given = {"replay_buffer_kwargs": {"n_steps": 4}, "policy_kwargs": {"greedy_shift_px": 1}}
    agent = DoubleDQN("MlpPolicy", DummyVecEnv([Signs]), gamma=0.5, buffer_size=10, **given)
    agent.save(tmp_path / "model.zip")
    for one in (agent, DoubleDQN.load(tmp_path / "model.zip", device="cpu", return_steps=2)):
        assert (one.replay_buffer.n_steps, one.replay_buffer.gamma) == (4, 0.5)
        assert one.policy.greedy_shift_px == 1


def test_every_view_is_drawn_as_often():
    torch.manual_seed(0)
    counts = torch.bincount(Views(SYMMETRIES).drawn(8000))
    assert len(counts) == 8
    assert (counts - 1000).abs().max() < 150


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


def test_values_are_advantages_around_a_value():
    network = model().q_net
    outputs = torch.tensor([[10.0, 1.0, 3.0]])
    network.q_net = torch.nn.Sequential(torch.nn.Flatten())
    network.extract_features = lambda obs, extractor: outputs
    torch.testing.assert_close(network(None), torch.tensor([[9.0, 11.0]]))


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


def test_shifts_move_images_sideways_and_repeat_the_edge():
    torch.manual_seed(0)
    images = torch.arange(4.0)[None, None, :, None].repeat(200, 9, 1, 2)
    moved = shifted(images, 1)
    assert torch.equal(moved[:, :1], moved[:, -1:])
    rows = {tuple(row) for row in moved[:, 0, :, 0].tolist()}
    assert rows == {(0, 1, 2, 3), (0, 0, 1, 2), (1, 2, 3, 3)}


def test_trunk_tells_where_something_is():
    torch.manual_seed(0)
    trunk = GridTrunk(spaces.Box(-3, 3, (90, 40, 1), np.float32))
    image = torch.zeros(1, 90, 40, 1)
    image[0, 40:50, 4:10] = 3.0
    with torch.no_grad():
        left, right = trunk(image), trunk(image.flip(2))
    assert left.shape == (1, 720)
    assert (left - right).abs().max() > 0.1 * left.abs().max()


@pytest.mark.parametrize(("groups", "names"), [(4, "GroupNorm"), (1, "GroupNorm"), (0, "")])
def test_trunk_has_another_grid_and_another_norm_where_asked(groups, names):
    trunk = GridTrunk(spaces.Box(-3, 3, (90, 40, 2), np.float32), grid=(2, 1), groups=groups)
    assert trunk(torch.zeros(3, 90, 40, 2)).shape == (3, trunk.features_dim) == (3, 2 * 48)
    found = {type(one).__name__ for one in trunk.modules() if "Norm" in type(one).__name__}
    assert found - {"NormalizedResidual"} == ({names} if names else set())
    # Wu and He (2018), Section 3.1: with one group it is layer norm.
    if groups == 1:
        norm = next(one for one in trunk.modules() if isinstance(one, torch.nn.GroupNorm))
        values = torch.randn(2, 16, 4, 4)
        expected = torch.nn.functional.layer_norm(values, (16, 4, 4))
        torch.testing.assert_close(norm(values), expected)


def test_trunk_refuses_images_that_are_too_small():
    with pytest.raises(ValueError, match="images must have at least 8 x 8 pixels, not 7 x 40"):
        GridTrunk(spaces.Box(-3, 3, (7, 40, 2), np.float32))


class Numbered(Signs):
    """Its k-th episode pays 100 k + 1, 100 k + 2, and so on; as `terminal`, episodes end by themselves."""

    def __init__(self, terminal=False):
        super().__init__(n_steps=16)
        self.terminal, self.episode = terminal, 0

    def reset(self, *, seed=None, options=None):
        self.episode += 1
        return super().reset(seed=seed)

    def step(self, action):
        image, _, _, ends, info = super().step(action)
        reward = float(100 * self.episode + self.step_number)
        return image, reward, ends and self.terminal, ends and not self.terminal, info


def numbered(n_envs=1, terminal=False):
    """An agent that only collects, whose returns are sums of three rewards."""
    env = DummyVecEnv([lambda: Numbered(terminal)] * n_envs)
    silent = {"learning_starts": 10**6, "buffer_size": 200, "train_freq": 1}
    return DoubleDQN("MlpPolicy", env, seed=0, gamma=1.0, return_steps=3, **silent)


def stopping_at(n_steps):
    """A callback that ends the rollout in which the agent makes so many steps."""
    return lambda seen, _: seen["self"].num_timesteps < n_steps


@pytest.mark.parametrize("n_envs", [1, 2])
@pytest.mark.parametrize("resets", [True, False])
@pytest.mark.parametrize("is_stopped", [True, False])
def test_returns_do_not_run_from_one_learning_into_the_next(n_envs, resets, is_stopped):
    agent = numbered(n_envs)
    agent.learn(20 * n_envs, callback=stopping_at(20 * n_envs) if is_stopped else None)
    agent.learn(20 * n_envs, reset_num_timesteps=resets)
    buffer, n = agent.replay_buffer, agent.replay_buffer.pos
    last = 18 if is_stopped else 19  # the step in which the callback ends the learning is not kept
    batch = buffer._get_samples(np.full(100, last))
    if resets or is_stopped:
        assert set(batch.rewards.flatten().tolist()) == {float(200 + last - 15)}
        assert set(batch.discounts.flatten().tolist()) == {1.0} and batch.dones.sum() == 0
        assert buffer.timeouts[:n].sum() == 3 * n_envs
        np.testing.assert_array_equal(buffer.rewards[last + 1], 301)
    else:  # the episode goes on, and so do its returns
        assert set(batch.rewards.flatten().tolist()) == {204.0 + 205.0 + 206.0}
        assert buffer.timeouts[:n].sum() == 2 * n_envs


def test_an_episode_that_was_over_before_the_next_learning_stays_terminal():
    agent = numbered(terminal=True).learn(16)
    agent.learn(4)
    batch = agent.replay_buffer._get_samples(np.array([15]))
    assert (batch.rewards.item(), batch.dones.item()) == (116.0, 1.0)


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
    agent = zoo.make("double_dqn", env, 0, chosen, device="cpu", symmetries=setting.symmetries())
    before = torch.cat([tensor.flatten() for tensor in agent.q_net.parameters()]).detach().clone()
    agent.learn(128)
    after = torch.cat([tensor.flatten() for tensor in agent.q_net.parameters()])
    assert torch.isfinite(after).all() and not torch.equal(before, after)
    assert len(agent.policy.q_net.views.mirrored) == len(setting.symmetries())


@pytest.mark.slow
def test_learns_a_plane_of_which_the_speckle_alone_tells_sides_apart(tmp_path):
    """In the views of drawn phantoms, in which both sides look alike, it had 0.2 after 16 064 steps."""
    trial = Trial.read(run_trial(resolve("double_dqn", "pp", steps=6400), tmp_path).folder)
    assert trial.last_evaluation(deterministic=True)["normalized_score"].mean() > 0.5
