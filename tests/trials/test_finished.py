"""A finished trial is not run again; one that was damaged is told of before anything runs, or made again."""

import itertools
import json
import os
import shutil
import zipfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
import trials
from state_files import read_state, write_state

from usbench import cli, records
from usbench.compare import sweep
from usbench.records import Trial
from usbench.trials import runner
from usbench.trials.configuration import resolve
from usbench.trials.finished import find_finished


class Notes:
    """A `sweep.Progress` that keeps what it was told."""

    def __init__(self):
        self.told = []

    def frames(self, *_):
        pass

    retried = frames

    def started(self, n_finished, expected):
        self.told.append((len(expected.each), n_finished))

    def ended(self, outcome):
        self.told.append(outcome.reason)


def config():
    """Of the trial in the fixture `finished`."""
    return resolve("vpg", "pp", steps=128, noise=0.5)


def swept(out, *configs):
    """Run a sweep; return what was told, and why the trials failed."""
    notes = Notes()
    outcomes = sweep.run(configs or [config()], out, notes, executor=lambda: ThreadPoolExecutor(1))
    return notes.told, [outcome.reason for outcome in outcomes]


def halve(path):
    os.truncate(path, path.stat().st_size // 2)


def empty(path):
    path.write_bytes(b"")


def change(path):
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 4
    path.write_bytes(content)


def remove(path):
    path.unlink()


def other_seed(path):
    path.write_text(path.read_text().replace('"seed": 0', '"seed": 4'))


@pytest.mark.parametrize(
    ("name", "damage"),
    [
        *itertools.product(
            (records.EPISODES, records.EVALUATIONS, records.MODEL), (halve, empty, change, remove)
        ),
        *itertools.product((records.TRIAL,), (halve, empty, change, other_seed)),
    ],
)
def test_damaged_file_of_a_finished_trial_is_said_in_one_sentence(finished, name, damage):
    whole = {path: path.read_bytes() for path in finished.glob("*.*")}
    damage(finished / name)
    told, (reason,) = swept(finished.parent)
    # At once, and no executor was made for it.
    assert told == [(0, 0), reason]
    assert reason.startswith(str(finished / name)) and "\n" not in reason
    said = (
        "is damaged, it is not what its trial wrote",
        "is not a trial record",
        "is missing: bring it back",
    )
    assert any(words in reason for words in said)
    # Nothing else was touched, so that what is brought back is as good as before.
    (finished / name).write_bytes(whole[finished / name])
    assert {path: path.read_bytes() for path in finished.glob("*.*")} == whole
    assert swept(finished.parent) == ([(0, 1)], [None])


def test_trial_without_its_record_is_run_again_and_has_the_same_bits(finished):
    bits = trials.bits(finished)
    (finished / records.TRIAL).unlink()
    assert swept(finished.parent) == ([(1, 0), None], [None])
    assert trials.bits(finished) == bits
    # What was there is kept.
    assert (finished.parent / f"{finished.name}.earlier-1" / records.EPISODES).exists()


def test_every_changed_digit_of_a_record_is_noticed(finished):
    path = finished / records.TRIAL
    text, trial = path.read_text(), Trial.read(finished)
    digits = [place for place, letter in enumerate(text) if letter.isdigit()]
    assert len(digits) > 300  # times, versions, anchors and settings among them
    for place in digits:
        path.write_text(text[:place] + str((int(text[place]) + 1) % 10) + text[place + 1 :])
        try:
            # The seventeenth digit of a number may say nothing.
            assert Trial.read(finished) == trial, place
        except ValueError as refused:
            assert str(refused).startswith(str(path))
    path.write_text(text)
    assert find_finished(config(), finished.parent)


@pytest.mark.parametrize("damage", [halve, empty, change, remove])
def test_events_of_tensorboard_are_no_part_of_the_results(finished, damage):
    bits = trials.bits(finished)
    damage(next((finished / records.TENSORBOARD).iterdir()))
    assert swept(finished.parent) == ([(0, 1)], [None])
    assert trials.bits(finished) == bits


def test_changed_weights_are_noticed(finished):
    path = finished / records.MODEL
    whole = path.read_bytes()
    with zipfile.ZipFile(path) as archive:
        start = whole.index(archive.read("policy.pth"))
    for where in range(start, start + 40_000, 4999):
        path.write_bytes(whole[:where] + bytes([whole[where] ^ 1]) + whole[where + 1 :])
        with pytest.raises(ValueError, match=r"model\.zip is damaged"):
            find_finished(config(), finished.parent)
    path.write_bytes(whole)
    assert find_finished(config(), finished.parent)


def test_trial_that_another_process_ends_meanwhile_is_not_taken_for_damaged(finished, tmp_path, monkeypatch):
    out, find = tmp_path / "others", Trial.find

    def ended_meanwhile(folder):
        if not folder.exists():
            shutil.copytree(finished, folder)
        return find(folder)

    monkeypatch.setattr(Trial, "find", ended_meanwhile)
    assert find_finished(config(), out).status == "finished"


def test_agents_that_do_not_learn_have_models_too(quick, tmp_path):
    planned = resolve("stay", "pp")
    swept(tmp_path, planned)
    assert swept(tmp_path, planned) == ([(0, 1)], [None])
    halve(tmp_path / planned.folder_name / records.MODEL)
    assert "model.zip is damaged" in swept(tmp_path, planned)[1][0]


def test_records_of_earlier_versions_without_checksums_are_finished_too(finished):
    state = read_state(finished)
    del state["checksums"]
    (finished / records.TRIAL).write_text(json.dumps(state))
    assert swept(finished.parent) == ([(0, 1)], [None])


def test_single_trial_and_table_are_refused_too(finished):
    change(finished / records.EPISODES)
    for read in (
        lambda: runner.run_trial(config(), finished.parent),
        lambda: records.load(finished.parent),
    ):
        with pytest.raises(ValueError, match="episodes.jsonl is damaged"):
            read()


@pytest.mark.parametrize(("name", "damage"), [(records.TRIAL, halve), (records.EPISODES, change)])
def test_damaged_trial_is_overwritten_where_asked(finished, name, damage):
    bits = trials.bits(finished)
    damage(finished / name)
    kept = (finished / name).read_bytes()
    out = str(finished.parent)
    argv = ["run", "--algo", "vpg", "--task", "pp", "--noise", "0.5", "--steps", "128", "--out", out]
    assert cli.main([*argv, "--quiet"]) == 1
    assert cli.main([*argv, "--quiet", "--overwrite"]) == 0
    assert trials.bits(finished) == bits
    assert (finished.parent / f"{finished.name}.earlier-1" / name).read_bytes() == kept


def test_comparison_says_it_and_runs_the_rest(finished, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sweep.run.__kwdefaults__, "executor", lambda: ThreadPoolExecutor(1))
    monkeypatch.setattr("usbench.compare.plan.REFERENCE_POLICIES", ("stay",))
    argv = ["compare", "--algos", "vpg", "--tasks", "pp", "--noise", "0.5", "--seeds", "1", "--steps", "128"]
    assert cli.main(argv) == 0
    (own,) = Path("runs").glob("*-vpg-s100-*")
    halve(own / records.EVALUATIONS)
    capsys.readouterr()
    assert cli.main(argv) == 1
    lines = capsys.readouterr().err.splitlines()
    told = [line for line in lines if not line.startswith("simulating")]
    assert told[0].startswith("0 trials to run, 1 finished already")
    assert told[1] == "vpg on pp, noise 0.5, seed 100: damaged"
    assert lines[-1].startswith("usbench: error: ") and "evaluations.jsonl is damaged" in lines[-1]
    assert [line for line in lines if "seed 100 failed" in line and "evaluations.jsonl is damaged" in line]
    assert len(list(finished.parent.glob("*/model.zip"))) == 3


def test_checkpoints_that_a_kill_left_beside_a_finished_trial_are_removed(finished):
    for again in (lambda: swept(finished.parent), lambda: runner.run_trial(config(), finished.parent)):
        (finished / records.CHECKPOINTS).mkdir()
        (finished / records.CHECKPOINTS / "000000000128.pt").touch()
        again()
        assert not (finished / records.CHECKPOINTS).exists()


@pytest.mark.parametrize(
    "name", ["/dev/zero", "../../outside", "tensorboard/../../outside", "tensorboard", ""]
)
def test_names_in_a_record_lead_nowhere_else(finished, name):
    write_state(finished, read_state(finished) | {"checksums": {name: "0" * 64}})
    for read in (
        lambda: Trial.read(finished),
        lambda: records.load(finished),
        lambda: find_finished(config(), finished.parent),
    ):
        with pytest.raises(ValueError, match="its checksums.* cannot be"):
            read()
