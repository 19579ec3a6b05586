"""Trials that learn in many environments in step: what they record, and how they go on after a kill."""

import dataclasses
from fractions import Fraction

import numpy as np
import pytest
import trials
from gymnasium.vector import AutoresetMode
from trials import Killed, Until

from usbench import records
from usbench.agents import zoo
from usbench.agents.vec_env import SB3VecEnv
from usbench.records import ConfigurationError, Trial
from usbench.setting import Setting
from usbench.trials import runner
from usbench.trials.configuration import resolve
from usbench.trials.recorder import Recorder, VectorRecorder


def test_one_environment_leaves_no_trace_in_a_trials_name():
    one, four = (trials.config("dqn", n_envs=n) for n in (1, 4))
    assert one.hash != four.hash
    # As before there could be more than one.
    assert "n_envs" not in records.identity(dataclasses.asdict(one))
    assert records.identity(dataclasses.asdict(four))["n_envs"] == 4


def test_row_says_how_many_environments_and_a_budget_that_they_share_evenly():
    assert resolve("double_dqn", "pp-tracked").n_envs == zoo.ZOO["double_dqn"].n_envs == 32
    assert resolve("double_dqn", "pp-tracked", steps=100).n_envs == 4
    assert resolve("dqn", "pp").n_envs == 1
    assert zoo.ZOO["ppo_asymmetric"].n_envs == 16


@pytest.mark.parametrize(("n_steps", "n_envs"), [(64, 16), (24, 8), (16, 8), (12, 4), (8, 4), (6, 2), (2, 1)])
def test_number_that_a_row_gets_by_itself_can_be_asked_for(n_steps, n_envs):
    short = {"n_steps": n_steps, "batch_size": 2}
    usual = resolve("ppo_asymmetric", "pp-tracked", steps=960, overrides=short)
    assert usual.n_envs == n_envs
    assert resolve("ppo_asymmetric", "pp-tracked", steps=960, overrides=short, n_envs=n_envs) == usual


def test_an_agent_that_is_not_stable_baselines_has_one_environment(monkeypatch):
    monkeypatch.setitem(zoo.ZOO, "mine", dataclasses.replace(zoo.ZOO["random"], n_envs=4))
    assert resolve("mine", "pp").n_envs == 1


@pytest.mark.parametrize(
    ("algo", "n_envs", "words"),
    [
        ("dqn", 0, "n_envs must be a whole number in .1, 1024., not 0"),
        ("dqn", 2.5, "n_envs must be a whole number in .1, 1024., not 2.5"),
        ("dqn", "many", "n_envs must be a whole number in .1, 1024., not 'many'"),
        ("dqn", 3, r"steps must be a multiple of n_envs \(3\), not 64"),
        ("ppo", 8, r"n_steps must be a multiple of n_envs \(8\), not 36"),
        ("vpg", 64, r"n_envs must be less than n_steps \(64\), not 64"),
        ("dqn", Fraction(10**400, 3), "n_envs must be a whole number in .1, 1024., not Fraction"),
        ("random", 2, "n_envs must be 1 for an agent that is not Stable-Baselines3's, not 2"),
    ],
)
def test_refuses_numbers_of_environments_that_cannot_be(algo, n_envs, words):
    with pytest.raises(ConfigurationError, match=words):
        overrides = {"n_steps": 36, "batch_size": 6} if algo == "ppo" else {}
        resolve(algo, "pp", steps=64, n_envs=n_envs, overrides=overrides)


@pytest.mark.parametrize("algo", ["double_dqn", "ppo"])
def test_trial_makes_exactly_its_steps_and_counts_those_of_all(quick, tmp_path, algo):
    config = trials.config(algo, steps=192, n_envs=4)
    trial = Trial.read(runner.run_trial(config, tmp_path).folder)
    episodes = trial.episodes()
    assert trial.config == config
    # Episodes of 16 steps, four at a time.
    assert episodes["step"].tolist() == [64] * 4 + [128] * 4 + [192] * 4
    assert episodes["episode"].tolist() == list(range(12))
    evaluated = trial.evaluations().drop_duplicates("checkpoint")
    assert evaluated["checkpoint"].tolist() == list(trial.evaluation_points)
    assert (evaluated["step"] - evaluated["checkpoint"]).between(0, 64).all()


@pytest.mark.parametrize("algo", ["double_dqn", "ppo"])
def test_trial_that_was_killed_goes_on_with_the_same_bits(often, tmp_path, algo):
    config = trials.config(algo, steps=192, n_envs=4)
    whole = runner.run_trial(config, tmp_path / "whole").folder
    with pytest.raises(Killed):
        runner.run_trial(config, tmp_path / "killed", progress=Until(100))
    ended = runner.run_trial(config, tmp_path / "killed").folder
    assert trials.bits(ended) == trials.bits(whole)


def vector(task, report, n_envs=3):
    setting = Setting(task=task, noise=0.5, n_frames=2)
    envs = SB3VecEnv(setting.make_vec_env(n_envs, autoreset_mode=AutoresetMode.SAME_STEP))
    for env in envs.env.unwrapped.envs:
        env.is_watched = False
    return VectorRecorder(envs, report)


@pytest.mark.parametrize("task", ["pp-random", "exam-stop"])
@pytest.mark.parametrize("n_steps", [0, 5, 16, 39])
def test_environments_put_back_go_on_as_they_did(task, n_steps):
    """Also where some have ended their episodes by themselves, so that all are at different steps."""

    def play(env, n):
        shown = []
        for _ in range(n):
            observations, rewards, dones, infos = env.step(actions.integers(n_actions, size=3))
            shown.append((np.asarray(observations).tobytes(), rewards.tolist(), dones.tolist(), str(infos)))
        return shown

    told, actions = [], np.random.default_rng(0)
    env = vector(task, told.append)
    n_actions = env.action_space.n
    env.seed(3)
    env.reset()
    play(env, n_steps)
    state = env.state()
    told.clear()
    position = actions.bit_generator.state
    expected = play(env, 40), list(told), env.n_steps
    again = vector(task, told.append)
    again.seed(4)
    told.clear()
    again.put_back(state)
    assert told == []
    actions.bit_generator.state = position
    assert (play(again, 40), told, again.n_steps) == expected
    assert told


def test_reports_are_those_of_single_environments():
    """The same seeds and actions: the same facts, with the steps of all beside them."""
    told, alone = [], []
    together = vector("pp-random", told.append)
    together.seed(5)
    together.reset()
    actions = np.random.default_rng(0).integers(5, size=(32, 3))
    for row in actions:
        together.step(row)
    for k in range(3):
        env = Recorder(Setting(task="pp-random", noise=0.5, n_frames=2).make_env(), alone.append)
        env.unwrapped.is_watched = False
        env.reset(seed=5 + k)
        for action in actions[:, k]:
            if env.step(action)[3]:
                env.reset()
    assert [facts.pop("step") for facts in told] == [48] * 3 + [96] * 3
    assert sorted(told, key=str) == sorted(alone, key=str)


def test_an_argument_that_there_is_not_is_refused_by_name():
    with pytest.raises(ConfigurationError, match=r"unknown argument 'step' \(did you mean 'steps'\?\)"):
        resolve("dqn", "pp", step=3)
