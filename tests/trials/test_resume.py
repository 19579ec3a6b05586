"""A trial that was ended at any moment goes on, and ends with the bits of one that never was."""

import logging
import threading

import numpy as np
import pytest
import trials
from state_files import read_state
from trials import ENDED_AT, FIRST_TOLD, Killed, Until, ended, go_on, killing

from usbench import records
from usbench.setting import make_env
from usbench.trials import callback, resume_files, runner
from usbench.trials.configuration import resolve
from usbench.trials.recorder import Recorder


# The others in tests/faults, at more moments.
@pytest.mark.parametrize("algo", ["vpg", "dqn", "recurrent_ppo"])
def test_killed_trial_goes_on_and_ends_with_the_bits_of_an_undisturbed_one(
    undisturbed, often, tmp_path, algo
):
    folder = ended(tmp_path, algo)
    assert read_state(folder)["status"] == "running"
    # The last rollout began at most 16 steps before.
    assert ENDED_AT - 16 < go_on(folder, algo) <= ENDED_AT
    assert trials.bits(folder) == trials.bits(undisturbed(algo))
    assert not (folder / records.CHECKPOINTS).exists()
    assert not list(tmp_path.glob("*.earlier-*"))


@pytest.mark.parametrize("algo", ["dqn", "trpo"])
def test_a_killed_trial_with_senses_ends_with_the_bits_of_an_undisturbed_one(often, tmp_path, algo):
    senses = ("position", "heading", "actions")
    config = resolve(algo, "pp", noise=0.5, steps=trials.STEPS, senses=senses, overrides=trials.SMALL[algo])
    whole = runner.run_trial(config, tmp_path / "whole").folder
    with pytest.raises(Killed):
        runner.run_trial(config, tmp_path / "killed", progress=Until(ENDED_AT))
    assert read_state(whole)["config"]["environment"]["senses"] == list(senses)
    assert trials.bits(runner.run_trial(config, tmp_path / "killed").folder) == trials.bits(whole)


def test_killed_again_and_again_while_it_ends(undisturbed, often, tmp_path, monkeypatch):
    folder = ended(tmp_path, step=FIRST_TOLD)
    for where in ("evaluate_due", "state", "put_back"):
        with monkeypatch.context() as patch:
            patch.setattr(callback.TrainingWatch, where, killing)
            with pytest.raises(Killed):
                go_on(folder)
    for where in ("_reference", "_save_model"):
        with monkeypatch.context() as patch:
            patch.setattr(runner._Run, where, killing)
            with pytest.raises(Killed):
                go_on(folder)
    # After the last step: nothing is trained again.
    assert go_on(folder) is None
    assert trials.bits(folder) == trials.bits(undisturbed("vpg"))


def test_interrupted_and_failed_trials_go_on_too(undisturbed, often, tmp_path):
    for step, error, status in ((20, KeyboardInterrupt, "interrupted"), (ENDED_AT, OSError, "failed")):
        with pytest.raises((KeyboardInterrupt, runner.TrialError)):
            runner.run_trial(trials.config("vpg"), tmp_path, progress=Until(step, error))
        (folder,) = records.trial_folders(tmp_path)
        assert read_state(folder)["status"] == status
    go_on(folder)
    assert trials.bits(folder) == trials.bits(undisturbed("vpg"))
    assert read_state(folder)["reason"] is None


def test_killed_while_it_ends_after_a_rollout_that_the_budget_cut_off(
    undisturbed, often, tmp_path, monkeypatch
):
    with monkeypatch.context() as patch:
        patch.setattr(runner._Run, "_reference", killing)
        with pytest.raises(Killed):
            runner.run_trial(trials.config("dqn"), tmp_path)
    folder = tmp_path / trials.config("dqn").folder_name
    # After the last step: nothing is trained again.
    assert go_on(folder, "dqn") is None
    assert trials.bits(folder) == trials.bits(undisturbed("dqn"))


def test_disk_that_takes_no_events_is_told_of_once(undisturbed, often, tmp_path, monkeypatch, capfd):
    def full(*_):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("tensorboard.summary.writer.record_writer.RecordWriter.write", full)
        with pytest.raises(runner.TrialError, match="No space left on device"):
            runner.run_trial(trials.config("vpg"), tmp_path)
    assert capfd.readouterr().err == ""
    folder = tmp_path / trials.config("vpg").folder_name
    go_on(folder)
    assert trials.bits(folder) == trials.bits(undisturbed("vpg"))


def test_time_before_the_kill_counts(often, tmp_path, monkeypatch):
    folder = ended(tmp_path)
    started = read_state(folder)["started"]
    path = sorted((folder / records.CHECKPOINTS).iterdir())[-1]
    content = resume_files._read(path)
    resume_files.ResumeFiles(folder, 0).write(int(path.stem), content | {"seconds": {"training_s": 1000.0}})
    go_on(folder)
    state = read_state(folder)
    assert 990 < state["timings"]["training_s"] < 1100 and state["started"] == started


def test_trial_killed_before_its_first_episode_leaves_nothing(undisturbed, quick, tmp_path, monkeypatch):
    for where in ("_frames", "_learning"):
        with monkeypatch.context() as patch:
            patch.setattr(runner._Run, where, killing)
            with pytest.raises(Killed):
                runner.run_trial(trials.config("vpg"), tmp_path)
    folder = tmp_path / trials.config("vpg").folder_name
    (folder / ".trial.json.abc.part").touch()
    (folder / records.CHECKPOINTS).mkdir()
    go_on(folder)
    assert {path.name for path in tmp_path.iterdir()} == {folder.name, ".locks"}
    assert trials.bits(folder) == trials.bits(undisturbed("vpg"))


def test_model_of_which_something_would_be_forgotten_has_no_checkpoints(often, tmp_path, caplog, monkeypatch):
    setup = runner.Learning.__init__

    def with_secret(self, *args, **kwargs):
        setup(self, *args, **kwargs)
        self.agent.secret = threading.Event()

    monkeypatch.setattr(runner.Learning, "__init__", with_secret)
    folder = ended(tmp_path)
    assert "VPG.secret cannot be kept" in caplog.text and not (folder / records.CHECKPOINTS).exists()
    assert caplog.text.count("cannot be kept") == 1


def test_algorithm_that_is_not_stable_baselines_starts_again_and_says_so(
    quick, tmp_path, monkeypatch, caplog
):
    code = "class Counter:\n    def __init__(self, policy, env, seed): self.env = env\n"
    code += "    def predict(self, observation, state=None, episode_start=None, deterministic=False):\n"
    code += "        return [0] * len(observation), state\n"
    code += "    def learn(self, steps):\n        self.env.reset()\n"
    code += "        for _ in range(steps): self.env.step([0])\n"
    (tmp_path / "simple_counter.py").write_text(code)
    monkeypatch.syspath_prepend(tmp_path)
    config = resolve("simple_counter:Counter", "pp", steps=64)
    with pytest.raises(Killed):
        runner.run_trial(config, tmp_path / "runs", progress=Until(32))
    folder = runner.run_trial(config, tmp_path / "runs").folder
    assert "starts from step 0" in caplog.text
    again = runner.run_trial(config, tmp_path / "again").folder
    assert (folder / records.EPISODES).read_bytes() == (again / records.EPISODES).read_bytes()


def test_second_process_waits_and_computes_nothing_twice(quick, tmp_path, caplog):
    first, skipped = Until(), {}
    begun = threading.Event()
    first.training = lambda *_: begun.set()
    config = trials.config("vpg")

    def run(name, progress):
        skipped[name] = runner.run_trial(config, tmp_path, progress=progress).skipped

    threads = [
        threading.Thread(target=run, args=("first", first)),
        threading.Thread(target=run, args=("second", None)),
    ]
    threads[0].start()
    assert begun.wait(60)
    threads[1].start()
    for thread in threads:
        thread.join(120)
    assert skipped == {"first": False, "second": True}
    assert "another process holds" in caplog.text
    assert not list(tmp_path.glob("*.earlier-*"))


@pytest.mark.parametrize("n_steps", [0, 5, 16, 39])
def test_environment_put_back_goes_on_as_it_did(quick, n_steps):
    def made():
        return Recorder(make_env("pp", noise=0.5), lambda facts: told.append(facts))

    def play(env, n):
        return [step(env) for _ in range(n)]

    def step(env):
        observation, reward, _, truncated, info = env.step(int(actions.integers(5)))
        if truncated:
            observation, info = env.reset()
        return observation.tobytes(), reward, truncated, info

    told, actions = [], np.random.default_rng(0)
    env = made()
    env.reset(seed=3)
    play(env, n_steps)
    state = env.state()
    told.clear()
    position = actions.bit_generator.state
    expected = play(env, 40), list(told), env.n_steps
    again = made()
    again.put_back(state)
    actions.bit_generator.state = position
    told.clear()
    assert (play(again, 40), told, again.n_steps) == expected


def test_warnings_are_the_projects_own(often, tmp_path, caplog):
    with caplog.at_level(logging.WARNING):
        go_on(ended(tmp_path))
    assert not caplog.records
