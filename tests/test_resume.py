"""A trial that was ended at any moment goes on, and ends with the bits of one that never was."""

import hashlib
import io
import logging
import os
import pickle
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
import torch

from usbench import checkpoints, learning, records, runner, suite, training
from usbench.evaluation import Recorder
from usbench.records import ConfigurationError

sys.path.insert(0, str(Path(__file__).parent))
import trials

ENDED_AT = 44
# Progress is told of whole episodes.
FIRST_TOLD = 16


class Killed(BaseException):
    """Stands for SIGKILL: nothing in the project catches it (tests/faults sends the real one)."""


class Until(training.Silent):
    """Ends a trial at a step, and keeps the first step that it was told."""

    def __init__(self, step=None, error=Killed):
        self.step, self.error, self.first = step, error, None

    def training(self, now, *_):
        self.first = self.first or now
        if now == self.step:
            raise self.error


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """`undisturbed(algo)`, in a quick test: a trial that nothing happened to, its checkpoints far apart."""
    done = {}

    def folder(algo):
        if algo not in done:
            with pytest.MonkeyPatch.context() as monkeypatch:
                monkeypatch.delenv(checkpoints.INTERVAL, raising=False)
                done[algo] = runner.run_trial(trials.config(algo), tmp_path_factory.mktemp(algo)).folder
        return done[algo]

    return folder


@pytest.fixture
def often(quick, monkeypatch):
    """A checkpoint before every rollout."""
    monkeypatch.setenv(checkpoints.INTERVAL, "0")


def ended(out, algo="vpg", step=ENDED_AT, error=Killed):
    """Run a trial up to a step; return its folder."""
    with pytest.raises(error):
        runner.run_trial(trials.config(algo), out, progress=Until(step, error))
    return out / trials.config(algo).folder_name


def go_on(folder, algo="vpg"):
    """Run the trial to its end; return the first step that was heard of."""
    progress = Until()
    assert not runner.run_trial(trials.config(algo), folder.parent, progress=progress).skipped
    return progress.first


# The others in tests/faults, at more moments.
@pytest.mark.parametrize("algo", ["vpg", "dqn", "recurrent_ppo"])
def test_killed_trial_goes_on_and_ends_with_the_bits_of_an_undisturbed_one(
    undisturbed, often, tmp_path, algo
):
    folder = ended(tmp_path, algo)
    assert records.read_state(folder)["status"] == "running"
    # The last rollout began at most 16 steps before.
    assert ENDED_AT - 16 < go_on(folder, algo) <= ENDED_AT
    assert trials.bits(folder) == trials.bits(undisturbed(algo))
    assert not (folder / records.CHECKPOINTS).exists()
    assert not list(tmp_path.glob("*.earlier-*"))


def test_killed_again_and_again_while_it_ends(undisturbed, often, tmp_path, monkeypatch):
    folder = ended(tmp_path, step=FIRST_TOLD)
    for where in ("evaluate_due", "state", "put_back"):
        with monkeypatch.context() as patch:
            patch.setattr(training.TrainingWatch, where, killing)
            with pytest.raises(Killed):
                go_on(folder)
    for where in ("_reference", "_save_model"):
        with monkeypatch.context() as patch:
            patch.setattr(runner._Trial, where, killing)
            with pytest.raises(Killed):
                go_on(folder)
    # After the last step: nothing is trained again.
    assert go_on(folder) is None
    assert trials.bits(folder) == trials.bits(undisturbed("vpg"))


def killing(*_):
    raise Killed


def test_interrupted_and_failed_trials_go_on_too(undisturbed, often, tmp_path):
    for step, error, status in ((20, KeyboardInterrupt, "interrupted"), (ENDED_AT, OSError, "failed")):
        with pytest.raises((KeyboardInterrupt, runner.TrialError)):
            runner.run_trial(trials.config("vpg"), tmp_path, progress=Until(step, error))
        (folder,) = records.trial_folders(tmp_path)
        assert records.read_state(folder)["status"] == status
    go_on(folder)
    assert trials.bits(folder) == trials.bits(undisturbed("vpg"))
    assert records.read_state(folder)["reason"] is None


def test_time_before_the_kill_counts(often, tmp_path, monkeypatch):
    folder = ended(tmp_path)
    started = records.read_state(folder)["started"]
    path = sorted((folder / records.CHECKPOINTS).iterdir())[-1]
    content = checkpoints._read(path)
    checkpoints.Checkpoints(folder, 0).write(int(path.stem), content | {"seconds": {"training_s": 1000.0}})
    go_on(folder)
    state = records.read_state(folder)
    assert 990 < state["timings"]["training_s"] < 1100 and state["started"] == started


def broken(path):
    path.write_bytes(path.read_bytes()[:-1] + b"\xff\xff")


@pytest.mark.parametrize(
    "damage",
    [
        broken,
        lambda path: path.unlink(),
        lambda path: seal(path, pickle.dumps(Malicious())),
        lambda path: change(path, agent={}),
        lambda path: change(path, environment={"origin": 1, "actions": [], "n_steps": 32}),
    ],
    ids=["changed", "gone", "malicious", "no agent", "moved"],
)
def test_broken_checkpoint_is_passed_over_for_the_one_before(undisturbed, often, tmp_path, caplog, damage):
    folder = ended(tmp_path)
    older, newest = sorted((folder / records.CHECKPOINTS).iterdir())
    damage(newest)
    there = newest.exists()
    assert go_on(folder) == int(older.stem) + 1
    assert caplog.text.count("passed over") == there
    assert not Malicious.done
    assert trials.bits(folder) == trials.bits(undisturbed("vpg"))


@pytest.mark.parametrize(
    "damage",
    [
        lambda path: path.write_bytes(path.read_bytes()[:100]),
        lambda path: path.write_bytes(b""),
        lambda path: path.write_bytes(b"something else"),
        lambda path: seal(path, b"something else"),
        lambda path: seal(path, saved(3)),
    ],
)
def test_file_that_is_no_checkpoint_is_passed_over(tmp_path, caplog, damage):
    kept = checkpoints.Checkpoints(tmp_path, 0)
    for step in (5, 10):
        kept.write(step, {"step": step})
    damage(kept.paths()[0])
    assert [content for _, content in kept.read()] == [{"step": 5}]
    assert caplog.text.count("passed over") == 1


class Malicious:
    """What a stranger may put into a file."""

    done: list[int] = []

    def __reduce__(self):
        return Malicious.done.append, (1,)


def saved(content):
    buffer = io.BytesIO()
    torch.save(content, buffer)
    return buffer.getvalue()


def seal(path, payload):
    """Write a file that looks like a checkpoint."""
    path.write_bytes(checkpoints._HEADER + hashlib.sha256(payload).digest() + payload)


def change(path, **content):
    seal(path, saved(checkpoints._read(path) | content))


def test_without_a_whole_checkpoint_it_starts_again_and_says_so(undisturbed, often, tmp_path, caplog):
    folder = ended(tmp_path)
    for path in (folder / records.CHECKPOINTS).iterdir():
        broken(path)
    assert go_on(folder) == FIRST_TOLD
    assert "starts from step 0" in caplog.text
    assert trials.bits(folder) == trials.bits(undisturbed("vpg"))
    assert (tmp_path / f"{folder.name}.earlier-1" / records.EPISODES).exists()


def test_trial_killed_before_its_first_episode_leaves_nothing(undisturbed, quick, tmp_path, monkeypatch):
    for where in ("_frames", "_learning"):
        with monkeypatch.context() as patch:
            patch.setattr(runner._Trial, where, killing)
            with pytest.raises(Killed):
                runner.run_trial(trials.config("vpg"), tmp_path)
    folder = tmp_path / trials.config("vpg").folder_name
    (folder / ".trial.json.abc.part").touch()
    (folder / records.CHECKPOINTS).mkdir()
    go_on(folder)
    assert {path.name for path in tmp_path.iterdir()} == {folder.name, ".locks"}
    assert trials.bits(folder) == trials.bits(undisturbed("vpg"))


@pytest.mark.parametrize(
    ("name", "damage"),
    [
        (records.EPISODES, lambda path: path.write_bytes(b"#" + path.read_bytes()[1:])),
        (records.EVALUATIONS, lambda path: path.unlink()),
    ],
)
def test_damaged_journal_is_not_gone_on_from(undisturbed, often, tmp_path, caplog, name, damage):
    folder = ended(tmp_path)
    damage(folder / name)
    assert go_on(folder) == FIRST_TOLD
    assert "is not what its trial wrote" in caplog.text and "starts from step 0" in caplog.text
    assert trials.bits(folder) == trials.bits(undisturbed("vpg"))


def test_lines_after_the_checkpoint_are_taken_away(undisturbed, often, tmp_path):
    folder = ended(tmp_path)
    with (folder / records.EPISODES).open("ab") as file:
        file.write(b'{"episode": 99}\n{"torn')
    go_on(folder)
    assert trials.bits(folder) == trials.bits(undisturbed("vpg"))


def test_checkpoint_of_other_circumstances_is_not_gone_on_from(often, tmp_path, caplog, monkeypatch):
    folder = ended(tmp_path)
    monkeypatch.setattr(runner, "machine", lambda: {"processor": "abacus"})
    monkeypatch.setattr(runner, "version", lambda _: "0.0.1")
    monkeypatch.setattr(learning, "_source", lambda _: "edited")
    assert go_on(folder) == FIRST_TOLD
    assert "differs in versions and processor and code" in caplog.text


def test_checkpoint_of_another_trial_is_not_gone_on_from(undisturbed, often, tmp_path, caplog):
    folder, other = ended(tmp_path), ended(tmp_path, "a2c")
    for path in (folder / records.CHECKPOINTS).iterdir():
        path.unlink()
    for path in (other / records.CHECKPOINTS).iterdir():
        path.rename(folder / records.CHECKPOINTS / path.name)
    assert go_on(folder) == FIRST_TOLD
    assert "differs in configuration" in caplog.text
    assert trials.bits(folder) == trials.bits(undisturbed("vpg"))


def test_two_are_kept_and_leftovers_of_killed_writers_removed(often, tmp_path):
    folder = ended(tmp_path)
    left = [folder / ".trial.json.abc.part", folder / records.CHECKPOINTS / ".000000000064.pt.abc.part"]
    for path in left:
        path.touch()
    assert len(list((folder / records.CHECKPOINTS).glob("*.pt"))) == checkpoints.KEPT == 2
    with pytest.raises(Killed):
        runner.run_trial(trials.config("vpg"), tmp_path, progress=Until(ENDED_AT + 1))
    assert not any(path.exists() for path in left)


def test_disk_that_takes_no_checkpoint_is_said_and_the_trial_ends(undisturbed, often, tmp_path, caplog):
    def full(*_):
        raise OSError(28, "No space left on device")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(checkpoints, "atomic_file", full)
        folder = runner.run_trial(trials.config("vpg"), tmp_path).folder
    assert "No space left on device" in caplog.text
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
    config = runner.resolve("simple_counter:Counter", "pp", steps=64)
    with pytest.raises(Killed):
        runner.run_trial(config, tmp_path / "runs", progress=Until(32))
    folder = runner.run_trial(config, tmp_path / "runs").folder
    assert "starts from step 0" in caplog.text
    again = runner.run_trial(config, tmp_path / "again").folder
    assert (folder / records.EPISODES).read_bytes() == (again / records.EPISODES).read_bytes()


@pytest.mark.parametrize("seconds", ["-1", "soon", "nan"])
def test_interval_that_is_no_time_is_refused(monkeypatch, seconds):
    monkeypatch.setenv(checkpoints.INTERVAL, seconds)
    with pytest.raises(ConfigurationError, match=f"at least 0, not '{seconds}'"):
        checkpoints.interval()


def test_interval_leaves_room_within_a_minute(monkeypatch):
    monkeypatch.delenv(checkpoints.INTERVAL, raising=False)
    assert 10 <= checkpoints.interval() <= 45


def test_no_checkpoint_before_it_is_time(tmp_path):
    kept = checkpoints.Checkpoints(tmp_path, 3600.0)
    assert kept.due()
    kept.write(0, {})
    assert not kept.due()


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
    assert "another process runs the trial" in caplog.text
    assert not list(tmp_path.glob("*.earlier-*"))


@pytest.mark.parametrize(
    ("name", "damage"),
    [
        (records.EPISODES, broken),
        (records.EPISODES, lambda path: path.unlink()),
        (records.EVALUATIONS, lambda path: os.truncate(path, 100)),
    ],
)
def test_damaged_records_of_a_finished_trial_are_refused_in_one_sentence(finished, name, damage):
    damage(finished / name)
    for read in (
        lambda: runner.run_trial(runner.resolve("vpg", "pp", steps=128, noise=0.5), finished.parent),
        lambda: records.load(finished.parent),
    ):
        with pytest.raises(ValueError, match=f"{name} is damaged"):
            read()


def test_checkpoints_that_a_kill_left_beside_a_finished_trial_are_removed(finished):
    (finished / records.CHECKPOINTS).mkdir()
    (finished / records.CHECKPOINTS / "000000000128.pt").touch()
    runner.run_trial(runner.resolve("vpg", "pp", steps=128, noise=0.5), finished.parent)
    assert not (finished / records.CHECKPOINTS).exists()


@pytest.mark.parametrize("n_steps", [0, 5, 16, 39])
def test_environment_put_back_goes_on_as_it_did(quick, n_steps):
    def made():
        return Recorder(suite.make_env("pp", 0.5), lambda facts: told.append(facts))

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
