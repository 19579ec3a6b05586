"""The distilled student: it learns what its teacher says, of the observations that it was said of."""

import numpy as np
import pytest
import torch
import trials
from signs import Signs
from stable_baselines3.common.callbacks import StopTrainingOnMaxEpisodes
from stable_baselines3.common.vec_env import DummyVecEnv
from trials import Killed, Until

from usbench import ceilings
from usbench.agents import model_state, zoo
from usbench.agents.vec_env import SB3VecEnv
from usbench.records import ConfigurationError
from usbench.setting import Setting
from usbench.trials import knowledge, runner
from usbench.trials.configuration import resolve
from usbench.trials.evaluation import explores
from usbench.watch.advice import Adviser

SMALL = {
    "learning_starts": 16,
    "train_freq": 4,
    "target_update_interval": 4,
    "batch_size": 16,
    "buffer_size": 1000,
}
TRACKED = {"task": "pp-tracked", "n_frames": 2, "senses": ("position", "heading", "actions")}


class Telling(Signs):
    """Says in its info which action is right."""

    def reset(self, *, seed=None, options=None):
        image, _ = super().reset(seed=seed)
        return image, {"right": self.right}

    def step(self, action):
        *found, _ = super().step(action)
        return *found, {"right": self.right}


class Knowing:
    """A teacher of these signs: the belief is the right action, and the other costs 2."""

    stay = 0

    def first(self, infos):
        return np.array([one["right"] for one in infos])

    def following(self, beliefs, actions, infos):
        return self.first(infos)

    def costs(self, beliefs):
        return (2.0 * (1 - np.eye(2)[beliefs])).astype(np.float32)


def model(n_envs=4, **settings):
    env = DummyVecEnv([Telling] * n_envs)
    chosen = zoo.hyperparameters("distilled", "pp-tracked", SMALL | settings)
    return zoo.make("distilled", env, 3, chosen, device="cpu", teacher=Knowing())


def right(observations):
    """Which half of each image is bright."""
    values = np.asarray(observations).mean(axis=(2, 3))
    return (values[:, 4:].mean(axis=1) > values[:, :4].mean(axis=1)).astype(int)


def test_student_learns_what_the_teacher_says_and_acts_alone_then():
    agent = model(learning_rate=1e-2).learn(512)
    assert agent.exploration_rate == 0
    envs = DummyVecEnv([Telling] * 50)
    envs.seed(7)
    seen = envs.reset()
    actions, _ = agent.predict(seen, deterministic=True)
    assert (actions == right(seen)).mean() > 0.95


def test_advice_is_that_of_the_observation_beside_which_it_is_remembered():
    agent = model(largest_cost=8.0).learn(200)
    observations, costs = agent.replay_buffer.advice(300)
    # The first action counts as staying: it costs a quarter of the largest cost, or as much as that.
    assert set(costs[:, 0].unique().tolist()) == {0.0, 1.0}
    assert set(costs[:, 1].unique().tolist()) == {0.0, 0.25}
    assert costs.argmin(1).tolist() == right(observations).tolist()


def test_teacher_acts_at_first_and_never_at_the_end():
    slow = {"learning_rate": 1e-9, "final_learning_rate": 1e-9}
    agent = model(learning_starts=64, exploration_fraction=0.5, **slow)
    taken = []
    step = agent.env.step
    agent.env.step = lambda actions: taken.append((actions == right(agent._last_obs)).mean()) or step(actions)
    agent.learn(640)
    assert np.mean(taken[:16]) == 1
    # Who has learnt nothing is right in half of the cases.
    assert 0.3 < np.mean(taken[-80:]) < 0.7


def test_learns_on_after_a_callback_has_ended_it_in_the_middle_of_a_step(tracked):
    agent = student(tracked.teacher)
    agent.learn(1000, callback=StopTrainingOnMaxEpisodes(2))
    assert agent.num_timesteps < 1000
    agent.learn(200, reset_num_timesteps=False)
    infos = [one._info({}) for one in agent.env.unwrapped.env.unwrapped.envs]
    seen = agent.teacher._graph.seen[agent._beliefs // agent.teacher._depths.n_columns]
    assert seen.tolist() == agent.teacher._observed[agent.teacher._hypotheses(infos)].tolist()


def test_student_acts_alone_whatever_the_teachers_share():
    agent = model(exploration_final_eps=1.0).learn(64)
    assert agent.exploration_rate == 1
    seen = DummyVecEnv([Telling] * 200).reset()
    assert np.array_equal(agent.predict(seen)[0], agent.policy.predict(seen)[0])
    assert not explores(agent)


def test_costs_above_the_largest_count_as_that():
    agent = model(largest_cost=0.5).learn(64)
    assert set(agent.replay_buffer.advice(300)[1].unique().tolist()) == {0.0, 1.0}


def test_what_an_update_makes_smaller_is_the_squared_error_of_the_costs(monkeypatch):
    """Its least is where the outputs are the mean costs (Ross and Bagnell 2014, Algorithm 1)."""
    agent = model()
    seen = torch.randn(2, *agent.observation_space.shape)
    costs = torch.tensor([[0.0, 1.0], [0.3, 0.0]])
    with torch.no_grad():
        expected = np.square(agent.q_net(seen).double().numpy() + costs.numpy()).mean()
    monkeypatch.setattr(agent.replay_buffer, "advice", lambda n: (seen, costs))
    assert agent._update(2) == pytest.approx(expected, rel=1e-4)
    assert agent._update(2) < expected


def test_learns_nothing_without_a_teacher():
    env = DummyVecEnv([Telling])
    agent = zoo.make("distilled", env, 0, zoo.hyperparameters("distilled", "pp-tracked", SMALL), device="cpu")
    with pytest.raises(ValueError, match="a distilled agent learns from a teacher"):
        agent.learn(8)


def student(teacher=None):
    """A student on the task that it is for, where nobody looks at frames."""
    setting = Setting(**TRACKED)
    env = SB3VecEnv(setting.make_vec_env(4, autoreset_mode="SameStep"))
    for one in env.env.unwrapped.envs:
        one.is_watched = False
    chosen = zoo.hyperparameters("distilled", setting.task, SMALL)
    made = {
        "device": "cpu",
        "symmetries": knowledge.symmetries(setting),
        "teacher": teacher or knowledge.teacher(setting),
    }
    return zoo.make("distilled", env, 0, chosen, **made)


@pytest.fixture(scope="module")
def tracked():
    """A student after a few updates."""
    return student().learn(128)


def test_student_of_a_task_knows_the_teachers_beliefs_after_its_own_steps(tracked):
    agent = tracked
    infos = [one._info({}) for one in agent.env.unwrapped.env.unwrapped.envs]
    teacher = agent.teacher
    seen = teacher._graph.seen[agent._beliefs // teacher._depths.n_columns]
    assert seen.tolist() == teacher._observed[teacher._hypotheses(infos)].tolist()
    told = agent.replay_buffer.told[:32]
    assert told.min() == 0 and told.max() == 1
    # It stays, or to stay is as bad as can be.
    assert set(np.unique(told[:, :, agent.teacher.stay])) <= {0.0, 1.0}


def test_advice_is_what_each_action_loses_and_no_return(tracked):
    agent = tracked
    observation = {name: values[0] for name, values in agent._last_obs.items()}
    advice = Adviser(agent).advise(observation, {}, 0)
    assert advice.kind == "loss" and max(advice.bars) == 1
    outputs = agent.policy.greedy_net(agent.policy.obs_to_tensor(observation)[0]).detach().numpy()[0]
    np.testing.assert_allclose(advice.weights, outputs * agent.largest_cost, rtol=1e-5)
    action, _ = agent.predict(observation, deterministic=True)
    assert int(np.argmax(advice.weights)) == int(action)


def test_state_has_beliefs_and_costs(tracked):
    agent = tracked
    state = model_state.state_of(agent)
    other = student(agent.teacher)
    model_state.put_back(other, state)
    assert other._beliefs.tolist() == agent._beliefs.tolist()
    np.testing.assert_array_equal(other.replay_buffer.told, agent.replay_buffer.told)
    assert "teacher" not in state["attributes"]


def test_trial_that_was_killed_goes_on_with_the_same_bits(often, tmp_path):
    small = {**SMALL, "learning_starts": 32}
    config = resolve("distilled", seed=0, steps=192, n_envs=4, overrides=small, **TRACKED)
    whole = runner.run_trial(config, tmp_path / "whole").folder
    with pytest.raises(Killed):
        runner.run_trial(config, tmp_path / "killed", progress=Until(128))
    ended = runner.run_trial(config, tmp_path / "killed").folder
    assert trials.bits(ended) == trials.bits(whole)


@pytest.mark.parametrize(
    ("task", "setting", "words"),
    [
        ("pp", {}, "a teacher is for tasks that draw phantoms .*, not for 'pp'"),
        ("exam-random", {}, "with a focus that moves, .* needs the senses 'position', 'focus', 'heading'"),
        ("pp-random", {"noise": 0.5}, "with noise, .* needs the senses 'position', 'heading', not none"),
    ],
)
def test_refuses_tasks_without_a_teacher(task, setting, words):
    with pytest.raises(ConfigurationError, match=words):
        resolve("distilled", task, **setting)


def test_largest_cost_is_checked():
    with pytest.raises(ConfigurationError, match="largest_cost must be"):
        resolve("distilled", overrides={"largest_cost": 0}, **TRACKED)


def test_rows_with_a_teacher_are_those_that_results_do_not_rank():
    assert {name for name, row in zoo.ZOO.items() if row.needs} == set(ceilings.TAUGHT)
