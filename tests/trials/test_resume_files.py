"""Damaged checkpoints and records: passed over, or refused in one sentence; never gone on from."""

import gc
import hashlib
import io
import shutil
import weakref
from pathlib import Path

import numpy as np
import pytest
import torch
import trials
from bomb import Bomb
from trials import ENDED_AT, FIRST_TOLD, Killed, Until, ended, go_on

from usbench import records
from usbench.records import ConfigurationError, Trial, checksums
from usbench.trials import learning, resume_files, runner

_KILLED = []


@pytest.fixture
def killed(often, tmp_path, tmp_path_factory):
    """Folder of a trial that was killed half-way; the trial runs once, each test has a copy."""
    if not _KILLED:
        _KILLED.append(ended(tmp_path_factory.mktemp("killed")))
    return Path(shutil.copytree(_KILLED[0], tmp_path / _KILLED[0].name))


def broken(path):
    path.write_bytes(path.read_bytes()[:-1] + b"\xff\xff")


@pytest.mark.parametrize(
    "damage",
    [
        broken,
        lambda path: path.unlink(),
        # A file that a careless reader would open.
        lambda path: seal(path, saved({"agent": Bomb(path.parents[2] / "ran")})),
        lambda path: change(path, agent={}),
        lambda path: change(path, environment={"origin": 1, "actions": [], "n_steps": 32}),
    ],
    ids=["changed", "gone", "malicious", "no agent", "moved"],
)
def test_broken_checkpoint_is_passed_over_for_the_one_before(undisturbed, killed, caplog, damage):
    older, newest = sorted((killed / records.CHECKPOINTS).iterdir())
    damage(newest)
    there = newest.exists()
    assert go_on(killed) == int(older.stem) + 1
    assert caplog.text.count("passed over") == there
    assert not (killed.parent / "ran").exists()
    assert trials.bits(killed) == trials.bits(undisturbed("vpg"))


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
    kept = resume_files.ResumeFiles(tmp_path, 0)
    for step in (5, 10):
        kept.write(step, {"step": step})
    damage(kept.paths()[0])
    assert [content for _, content in kept.read()] == [{"step": 5}]
    assert caplog.text.count("passed over") == 1


def saved(content):
    buffer = io.BytesIO()
    torch.save(content, buffer)
    return buffer.getvalue()


def seal(path, payload):
    """Write a file that looks like a checkpoint."""
    path.write_bytes(resume_files._HEADER + hashlib.sha256(payload).digest() + payload)


def change(path, **content):
    seal(path, saved(resume_files._read(path) | content))


def test_without_a_whole_checkpoint_it_starts_again_and_says_so(undisturbed, killed, tmp_path, caplog):
    for path in (killed / records.CHECKPOINTS).iterdir():
        broken(path)
    assert go_on(killed) == FIRST_TOLD
    assert "starts from step 0" in caplog.text
    assert trials.bits(killed) == trials.bits(undisturbed("vpg"))
    assert (tmp_path / f"{killed.name}.earlier-1" / records.EPISODES).exists()


@pytest.mark.parametrize(
    ("name", "damage"),
    [
        (records.EPISODES, lambda path: path.write_bytes(b"#" + path.read_bytes()[1:])),
        (records.EVALUATIONS, lambda path: path.unlink()),
    ],
)
def test_damaged_journal_is_not_gone_on_from(undisturbed, killed, caplog, name, damage):
    damage(killed / name)
    assert go_on(killed) == FIRST_TOLD
    assert "is not what its trial wrote" in caplog.text and "starts from step 0" in caplog.text
    assert trials.bits(killed) == trials.bits(undisturbed("vpg"))


def test_lines_after_the_checkpoint_are_taken_away(undisturbed, killed):
    with (killed / records.EPISODES).open("ab") as file:
        file.write(b'{"episode": 99}\n{"torn')
    go_on(killed)
    assert trials.bits(killed) == trials.bits(undisturbed("vpg"))


def test_nothing_that_a_checkpoint_holds_is_kept_while_the_training_goes_on(killed, monkeypatch):
    read, held, alive = resume_files._read, [], []

    def noted(path):
        content = read(path)
        content["noted"] = np.zeros(1)  # as a replay buffer's frames
        held.append(weakref.ref(content["noted"]))
        return content

    def learn(self, *args):
        gc.collect()
        alive.append(held[0]() is not None)
        return train(self, *args)

    train = learning.Learning.learn
    monkeypatch.setattr(resume_files, "_read", noted)
    monkeypatch.setattr(learning.Learning, "learn", learn)
    assert go_on(killed)
    assert alive == [False]


def test_checkpoint_of_other_circumstances_is_not_gone_on_from(killed, caplog, monkeypatch):
    monkeypatch.setattr(learning, "machine", lambda: {"processor": "abacus"})
    monkeypatch.setattr(runner, "versions", lambda: {"python": "3.11", "usbench": "0.0.1"})
    monkeypatch.setattr(checksums, "of_modules", lambda _: "edited")
    assert go_on(killed) == FIRST_TOLD
    assert "differs in versions and processor and code" in caplog.text


@pytest.mark.parametrize("on_the_way", [True, False])
def test_checkpoint_with_other_evaluation_points_is_not_gone_on_from(often, tmp_path, caplog, on_the_way):
    config = trials.config("vpg")
    with pytest.raises(trials.Killed):
        runner.run_trial(config, tmp_path, progress=Until(ENDED_AT), evaluates_on_the_way=not on_the_way)
    trial = Trial.read(runner.run_trial(config, tmp_path, evaluates_on_the_way=on_the_way).folder)
    assert "comes from a trial that differs in evaluation_points" in caplog.text
    assert trial.evaluation_points == ((0, 32, 64) if on_the_way else (64,))
    assert tuple(sorted(set(trial.evaluations()["checkpoint"]))) == trial.evaluation_points


def test_checkpoint_of_another_trial_is_not_gone_on_from(undisturbed, killed, tmp_path, caplog):
    other = ended(tmp_path, "a2c")
    for path in (killed / records.CHECKPOINTS).iterdir():
        path.unlink()
    for path in (other / records.CHECKPOINTS).iterdir():
        path.rename(killed / records.CHECKPOINTS / path.name)
    assert go_on(killed) == FIRST_TOLD
    assert "differs in configuration" in caplog.text
    assert trials.bits(killed) == trials.bits(undisturbed("vpg"))


def test_two_are_kept_and_leftovers_of_killed_writers_removed(killed, tmp_path):
    left = [killed / ".trial.json.abc.part", killed / records.CHECKPOINTS / ".000000000064.pt.abc.part"]
    for path in left:
        path.touch()
    assert len(list((killed / records.CHECKPOINTS).glob("*.pt"))) == resume_files.KEPT == 2
    with pytest.raises(Killed):
        runner.run_trial(trials.config("vpg"), tmp_path, progress=Until(ENDED_AT + 1))
    assert not any(path.exists() for path in left)


def test_disk_that_takes_no_checkpoint_is_said_and_the_trial_ends(undisturbed, often, tmp_path, caplog):
    def full(*_):
        raise OSError(28, "No space left on device")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(resume_files, "atomic_file", full)
        folder = runner.run_trial(trials.config("vpg"), tmp_path).folder
    assert "No space left on device" in caplog.text
    assert trials.bits(folder) == trials.bits(undisturbed("vpg"))


@pytest.mark.parametrize("seconds", ["-1", "soon", "nan"])
def test_interval_that_is_no_time_is_refused(monkeypatch, seconds):
    monkeypatch.setenv(resume_files.INTERVAL, seconds)
    with pytest.raises(ConfigurationError, match=f"at least 0, not '{seconds}'"):
        resume_files.interval()


def test_interval_leaves_room_within_a_minute(monkeypatch):
    monkeypatch.delenv(resume_files.INTERVAL, raising=False)
    assert 10 <= resume_files.interval() <= 45


def test_no_checkpoint_before_it_is_time(tmp_path):
    kept = resume_files.ResumeFiles(tmp_path, 3600.0)
    assert kept.due()
    kept.write(0, {})
    assert not kept.due()
