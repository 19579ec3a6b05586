"""The classical agent: what it infers from a recogniser that is right, and what it makes of its frames."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch
from stable_baselines3.common.vec_env import DummyVecEnv
from torch._subclasses.fake_tensor import FakeTensorMode

from usbench.agents import zoo
from usbench.agents.taught.belief import BeliefAgent, RecognisingPolicy
from usbench.agents.vec_env import SB3VecEnv
from usbench.records import ConfigurationError
from usbench.setting import Setting
from usbench.trials import knowledge, runner
from usbench.trials.configuration import resolve
from usbench.trials.evaluation import Evaluator
from usbench.trials.model_loading import load_agent
from usbench.watch.advice import Adviser

SMALL = {"learning_starts": 16, "train_freq": 4, "batch_size": 16, "buffer_size": 1000}
SETTING = Setting(task="pp-tracked", n_frames=1)


def unwatched(env):
    for one in env.env.unwrapped.envs:
        one.is_watched = False
    return env


def made():
    env = unwatched(SB3VecEnv(SETTING.make_vec_env(4, autoreset_mode="SameStep")))
    chosen = zoo.hyperparameters("belief", "pp-tracked", SMALL)
    return zoo.make("belief", env, 0, chosen, device="cpu", model=knowledge.scene_model(SETTING))


@pytest.fixture(scope="module")
def agent():
    return made().learn(64)


class Sees(torch.nn.Module):
    """A recogniser that is told the truth: a frame whose first pixel is the number of its look."""

    def __init__(self, n_looks):
        super().__init__()
        self.n_looks = n_looks

    def forward(self, observations):
        looks = observations["image"][:, 0, 0, -1].long()
        return 20.0 * torch.nn.functional.one_hot(looks, self.n_looks).float()


def test_with_ideal_eyes_it_reaches_every_goal():
    """Votes lose next to nothing of the ceiling, and never rest a turn away from the plane."""
    agent, task = made(), SETTING.plain_env().task
    model = agent.model
    agent.policy.q_net_target = Sees(model.n_looks)
    rng = np.random.default_rng(0)
    n = 400
    at = [task.starts[k] for k in rng.integers(len(task.starts), size=n)]
    places = rng.integers(model.looks.shape[1], size=n)
    known, total = None, np.zeros(n)
    for step in range(task.n_steps):
        states = np.array([task.indices[pose] for pose in at])
        images = np.zeros((n, 90, 40, 1), np.float32)
        images[:, 0, 0, 0] = model.looks[states, places]
        senses = model._told[states]
        first = np.full(n, step == 0)
        actions, known = agent.predict({"image": images, "senses": senses}, known, first, deterministic=True)
        at = [pose.moved(task.actions[a].move, task.limits) for pose, a in zip(at, actions, strict=True)]
        targets = [model._known.targets[place] for place in places]
        total += [task.reward(pose, one, "normalized") for pose, one in zip(at, targets, strict=True)]
    assert all(task.is_success(pose, one) for pose, one in zip(at, targets, strict=True))
    assert model._known.anchors.score(total.mean()) > 0.97


def test_a_frame_of_the_same_pose_tells_nothing_twice(agent):
    seen = agent._last_obs
    _, once = agent.predict(seen, None, np.ones(4, bool), deterministic=True)
    _, twice = agent.predict(seen, once, np.zeros(4, bool), deterministic=True)
    np.testing.assert_allclose(once.evidence, twice.evidence, atol=1e-5)
    _, anew = agent.predict(seen, twice, np.ones(4, bool), deterministic=True)
    np.testing.assert_allclose(once.evidence, anew.evidence, atol=1e-5)
    assert twice.visited.sum() == 4


def test_it_remembers_the_true_look_of_every_frame_and_counts_it(agent):
    looks = agent.replay_buffer.told[: agent.replay_buffer.size(), :, 0]
    counts = np.bincount(looks.astype(int).ravel(), minlength=agent.model.n_looks)
    np.testing.assert_array_equal(agent.policy.counts.numpy(), 1 + counts)
    assert counts.sum() == 64


def test_looks_are_counted_on_the_device_of_the_policy():
    """PyTorch's fake tensors refuse what a GPU refuses, and need none."""
    agent, infos = made(), [{}] * 4
    agent.model = SimpleNamespace(look=lambda infos: np.zeros(len(infos), np.int64))
    agent._begin(infos)
    with FakeTensorMode(allow_non_fake_inputs=True):
        agent.policy.counts = torch.ones(agent.policy.n_looks, device="cuda")
        agent._go_on(np.zeros(4, np.int64), np.zeros(4, bool), infos)
    assert agent.policy.counts.device.type == "cuda"


def test_recogniser_looks_at_the_last_frame_alone(agent):
    trunk = agent.policy.q_net.features_extractor
    image = torch.randn(2, 90, 40, 1)
    with torch.no_grad():
        one = trunk({"image": image, "senses": torch.zeros(2, 3)})
        other = trunk(
            {"image": torch.cat([torch.randn(2, 90, 40, 2), image], -1), "senses": torch.ones(2, 3)}
        )
    torch.testing.assert_close(one, other)


def test_a_recogniser_that_was_saved_alone_tells_the_same_looks(agent, tmp_path):
    agent.policy.save(tmp_path / "policy.pt")
    loaded = RecognisingPolicy.load(tmp_path / "policy.pt", device="cpu")
    assert torch.equal(loaded.counts, agent.policy.counts)
    seen, _ = agent.policy.obs_to_tensor(agent._last_obs)
    with torch.no_grad():
        assert torch.equal(loaded.greedy_net(seen), agent.policy.greedy_net(seen))


def test_trial_is_evaluated_loaded_and_gives_advice(quick, tmp_path):
    config = resolve("belief", "pp-tracked", steps=128, n_envs=4, n_frames=1, overrides=SMALL)
    folder = runner.run_trial(config, tmp_path).folder
    loaded = load_agent(folder).agent
    # As Stable-Baselines3 opens it, too; the model of the task is no part of the file.
    again = BeliefAgent.load(folder / "model.zip", device="cpu")
    assert torch.equal(again.policy.counts, loaded.policy.counts)
    episodes = SETTING.evaluation_episodes()[:2]
    played = Evaluator(SETTING, episodes).play(loaded, checkpoint=0, step=0, deterministic=True)
    assert len(played) == 2
    env = SETTING.make_env()
    observation, info = env.reset(seed=0)
    advice = Adviser(loaded).advise(observation, info, 0)
    assert sorted(advice.weights) == [0, 0, 0, 0, 1]


@pytest.mark.parametrize(
    ("task", "setting", "words"),
    [
        ("pp", {}, "a classical agent is for tasks that draw phantoms .*, not for 'pp'"),
        ("exam-tracked", {}, "does not know how frames change with the focus, which the task 'exam-tracked'"),
        ("pp-random", {}, "needs the senses 'position', 'heading', not none"),
    ],
)
def test_refuses_tasks_that_it_does_not_know(task, setting, words):
    with pytest.raises(ConfigurationError, match=words):
        resolve("belief", task, **setting)


def test_a_loaded_agent_asks_for_its_model(agent, tmp_path):
    agent.save(tmp_path / "model.zip")
    loaded = BeliefAgent.load(tmp_path / "model.zip", env=agent.get_env(), device="cpu")
    observation = SETTING.make_env().observation_space.sample()
    for use in (lambda: loaded.predict(observation), lambda: loaded.learn(64)):
        with pytest.raises(ValueError, match="set `model` after loading it"):
            use()
    loaded.model = agent.model
    loaded.predict(observation)


def test_refuses_to_be_made_without_a_model():
    env = DummyVecEnv([SETTING.make_env])
    with pytest.raises(ValueError, match="a belief agent knows its task: make it with a model"):
        zoo.make("belief", env, 0, zoo.hyperparameters("belief", "pp-tracked", SMALL), device="cpu")
