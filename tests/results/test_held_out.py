"""Agents of one phantom on unseen phantoms: tables worked out by hand, and a test from end to end."""

import logging
import re
import shutil

import numpy as np
import pandas as pd
import pytest
from filelock import Timeout
from made_tables import made, seeds, trial
from state_files import read_state

from usbench import cli, records, suite
from usbench.compare import transfer
from usbench.records import ConfigurationError
from usbench.records.lock import lock_of
from usbench.results import collecting, held_out, leaderboard, tables
from usbench.setting import Setting
from usbench.trials import runner
from usbench.trials.configuration import resolve


def rows_of(*scores):
    rows = [
        (f"pp-p0-vpg-s{seed}", "pp-random", 56, score, -9.0, 0.5) for seed, score in enumerate(scores, 100)
    ]
    return pd.DataFrame(rows, columns=list(held_out.COLUMNS))


KNOWN = made(*seeds("vpg", [0.8, 0.9], task="pp"), *seeds("vpg", [0.5, 0.7], task="pp-random"))


def test_the_gap_lies_between_one_and_many_on_the_same_phantoms():
    (row,) = held_out.table(KNOWN, rows_of(0.1, 0.3)).to_dict("records")
    assert (row["task"], row["noise"], row["agent"]) == ("pp-random", 0.0, "vpg")
    # The interquartile mean of two is their mean.
    assert (row["seen"], row["one"], row["many"]) == pytest.approx((0.85, 0.2, 0.6))
    assert row["gap"] == pytest.approx(0.4)
    assert (row["one_seeds"], row["many_seeds"]) == (2, 2)
    assert row["one_low"] == pytest.approx(0.1) and row["one_high"] == pytest.approx(0.3)


def test_only_trials_that_were_tested_have_a_row():
    assert held_out.table(KNOWN, rows_of()).empty
    alone = made(*seeds("vpg", [0.8], task="pp"), trial("ppo", task="pp"))
    (row,) = held_out.table(alone, rows_of(0.1)).to_dict("records")
    assert row["agent"] == "vpg" and np.isnan(row["many"]) and np.isnan(row["gap"])


def test_both_scores_of_an_agent_are_over_the_trials_that_were_tested():
    known = made(*seeds("vpg", [0.9, 0.9, 0.1, 0.1], task="pp"))
    (row,) = held_out.table(known, rows_of(0.8, 0.8)).to_dict("records")
    assert (row["seen"], row["seen_seeds"], row["one"]) == (pytest.approx(0.9), 2, pytest.approx(0.8))


def test_configurations_of_an_agent_are_not_pooled():
    other = seeds("vpg", [0.1], task="pp", configuration="00000002", trial="other")
    known = made(*seeds("vpg", [0.8, 0.9], task="pp"), *other, *seeds("vpg", [0.5, 0.7], task="pp-random"))
    more = pd.DataFrame([("other", "pp-random", 56, 0.0, -9.0, 0.5)], columns=list(held_out.COLUMNS))
    found = held_out.table(known, pd.concat([rows_of(0.1, 0.3), more]))
    assert list(found["agent"]) == ["vpg", "vpg 00000002"]
    assert list(found["one_seeds"]) == [2, 1]
    # What was trained on many phantoms is of the row's settings.
    assert list(found["many_seeds"]) == [2, 0] and list(found["gap"].isna()) == [False, True]


def test_the_leaderboard_has_the_track_only_with_tests(tmp_path):
    folder = leaderboard.files(tmp_path / "leaderboard.md")
    tables.write(KNOWN, folder)
    assert "nseen phantoms" not in leaderboard.write(folder, tmp_path / "leaderboard.md")[0].read_text()
    held_out.write(rows_of(0.1, 0.3), folder)
    text = leaderboard.write(folder, tmp_path / "leaderboard.md")[0].read_text()
    (line,) = [line for line in text.splitlines() if "pp-random, noise 0 |" in line]
    assert line == (
        "| `vpg` | pp-random, noise 0 | 0.850 [0.800, 0.900] | 0.200 [0.100, 0.300] | 0.600 [0.500, 0.700] "
        "| 0.400 | 2 and 2 |"
    )


def test_the_section_is_folded_and_has_no_columns_on_agents_that_there_are_not():
    without = made(*seeds("vpg", [0.8, 0.9], task="pp"))
    text = leaderboard.markdown(without, rows_of(0.1, 0.3)).split("## Unseen phantoms\n")[1]
    section = text.split("\n## ")[0]
    about, fold, *rows = [line for line in section.splitlines() if line and line != "<details>"]
    assert (
        about.startswith("Scores (IQM")
        and "many" not in about
        and fold == "<summary>Scores (1 row)</summary>"
    )
    assert rows == [
        "| agent | phantoms of | on its own phantom | on unseen phantoms | seeds |",
        "| --- | --- | ---: | ---: | ---: |",
        "| `vpg` | pp-random, noise 0 | 0.850 [0.800, 0.900] | 0.200 [0.100, 0.300] | 2 |",
        "</details>",
    ]


def test_a_table_of_something_else_is_refused(tmp_path):
    (tmp_path / held_out.TABLE).write_text("trial,score\na,1\n")
    with pytest.raises(ValueError, match=r"held_out.csv is not a table of tests"):
        held_out.read(tmp_path)


def play(folder, algos=None, tell=lambda _: None):
    """Test what is untested of the trials and tables in `folder`."""
    return transfer.write(folder, folder, transfer.untested(folder, folder, algos=algos, tell=tell), tell)


def test_an_agent_is_tested_once_on_every_phantom_of_the_list(finished, tmp_path, monkeypatch, capsys):
    tables.write(collecting.collect(finished.parent), tmp_path / "leaderboard_files")
    command = ["transfer", "--runs", str(finished.parent), "--leaderboard", str(tmp_path / "leaderboard.md")]
    assert cli.main([*command, "--quiet"]) == 0
    (row,) = held_out.read(tmp_path / "leaderboard_files").to_dict("records")
    assert (row["trial"], row["task"]) == (finished.name, "pp-random")
    assert row["episodes"] == len(suite.evaluation_episodes("pp-random"))
    anchors = Setting(task="pp-random", noise=read_state(finished)["config"]["noise"]).anchors()
    expected = (row["return"] - anchors.random) / (anchors.optimal - anchors.random)
    assert row["normalized_score"] == pytest.approx(expected, abs=1e-4)
    assert "## Unseen phantoms" in (tmp_path / "leaderboard.md").read_text()
    shutil.rmtree(finished)
    assert cli.main([*command, "--quiet"]) == 0  # nothing is opened again
    capsys.readouterr()
    assert cli.main([*command[:2], str(tmp_path / "nowhere"), *command[3:]]) == 2
    assert "there is no folder" in capsys.readouterr().err


def test_an_agent_that_is_told_its_actions_is_told_them_there_too(quick, tmp_path):
    folder = runner.run_trial(resolve("vpg", "pp", steps=64, senses=("actions",)), tmp_path).folder
    last = records.Trial.read(folder).last_evaluation(deterministic=True)
    row = transfer.test(folder, "vpg", last["normalized_score"].mean())
    assert row["task"] == "pp-random" and row["episodes"] == len(suite.evaluation_episodes("pp-random"))


@pytest.mark.parametrize(("option", "value"), [("--algos", "nope"), ("--tasks", "exam"), ("--noise", "0.3")])
def test_what_no_trial_has_is_refused_before_anything_is_written(
    tmp_path, monkeypatch, capsys, option, value
):
    (tmp_path / "runs").mkdir()
    monkeypatch.chdir(tmp_path)
    assert cli.main(["transfer", "--quiet", option, value]) == 2
    assert "there is no such trial to test with" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["runs"]


def test_a_leaderboard_that_is_named_and_has_no_tables_is_refused(finished, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    # There are tables, which a misspelt name must not mean.
    tables.write(collecting.collect(finished.parent), tmp_path / "leaderboard_files")
    assert cli.main(["transfer", "--quiet", "--leaderboard", "nowhere/leaderbord.md"]) == 2
    error = capsys.readouterr().err
    assert "the leaderboard 'nowhere/leaderbord.md' has no tables" in error and error.count("\n") == 1
    assert not (tmp_path / "nowhere").exists()


def test_one_cell_can_be_tested_alone(tmp_path):
    cells = [seeds("vpg", [0.8, 0.9], task=task, noise=noise) for task in ("fp", "pp") for noise in (0, 0.25)]
    tables.write(made(*(row for cell in cells for row in cell)), tmp_path)
    for name in ("pp-p0.25-vpg-s100", "pp-p0.25-vpg-s101"):
        (tmp_path / name).mkdir()
        (tmp_path / name / records.TRIAL).touch()
    missing = transfer.untested(tmp_path, tmp_path, tasks=["pp"], noises=[0.25])
    assert list(missing["trial"]) == ["pp-p0.25-vpg-s100", "pp-p0.25-vpg-s101"]


def test_without_a_trial_on_one_phantom_there_is_nothing_to_test(tmp_path):
    tables.write(made(trial("vpg", task="pp-random"), trial("oracle", task="pp")), tmp_path)
    with pytest.raises(ConfigurationError, match="no finished trial on fp, pp"):
        transfer.untested(tmp_path, tmp_path)


def test_what_was_tested_is_kept_when_a_later_test_fails(tmp_path, monkeypatch):
    names = ["pp-p0-vpg-s100", "pp-p0-vpg-s101", "pp-p0-vpg-s102"]
    for name in names:
        (tmp_path / name).mkdir()
        (tmp_path / name / records.TRIAL).touch()
    tables.write(made(*seeds("vpg", [0.8, 0.9, 0.7], task="pp")), tmp_path)
    monkeypatch.setattr("usbench.compare.transfer.Setting.prepare_frames", lambda *_: None)

    def test(trial, algo, score):
        if trial.name == names[1]:
            raise ConfigurationError("its model is broken.")
        if trial.name == names[2]:
            raise KeyboardInterrupt
        return rows_of(0.1).iloc[0].to_dict()

    monkeypatch.setattr(transfer, "test", test)
    with pytest.raises(KeyboardInterrupt):
        play(tmp_path)
    assert list(held_out.read(tmp_path)["trial"]) == names[:1]
    shutil.rmtree(tmp_path / names[2])
    tables.write(made(*seeds("vpg", [0.8, 0.9], task="pp")), tmp_path)
    assert play(tmp_path) == ["its model is broken."]


def test_frames_that_are_simulated_are_told(tmp_path, monkeypatch):
    tables.write(made(*seeds("vpg", [0.8], task="pp")), tmp_path)
    (tmp_path / "pp-p0-vpg-s100").mkdir()
    (tmp_path / "pp-p0-vpg-s100" / records.TRIAL).touch()

    def simulate(_setting, report):
        for done in range(1, 61):
            report(done, 60)

    monkeypatch.setattr("usbench.compare.transfer.Setting.prepare_frames", simulate)
    monkeypatch.setattr(transfer, "test", lambda *_: rows_of(0.1).iloc[0].to_dict())
    told = []
    transfer.write(tmp_path, tmp_path, transfer.untested(tmp_path, tmp_path), told.append)
    assert told[:-1] == ["frames of pp-random", *(f"simulating frames: {n} of 60" for n in (25, 50, 60))]


def test_tests_that_another_process_writes_meanwhile_stay(tmp_path, monkeypatch):
    names = ["fp-p0-vpg-s100", "pp-p0-vpg-s100"]
    for name in names:
        (tmp_path / name).mkdir()
        (tmp_path / name / records.TRIAL).touch()
    tables.write(made(*seeds("vpg", [0.8], task="fp"), *seeds("vpg", [0.9], task="pp")), tmp_path)
    monkeypatch.setattr("usbench.compare.transfer.Setting.prepare_frames", lambda *_: None)

    def test(trial, algo, score):
        if trial.name == names[0]:  # while it is tested, another process tests the other
            transfer.write(tmp_path, tmp_path, transfer.untested(tmp_path, tmp_path, tasks=["pp"]))
        return rows_of(score).iloc[0].to_dict() | {"trial": trial.name}

    monkeypatch.setattr(transfer, "test", test)
    transfer.write(tmp_path, tmp_path, transfer.untested(tmp_path, tmp_path, tasks=["fp"]))
    tested = held_out.read(tmp_path)
    assert list(tested["trial"]) == names and list(tested["normalized_score"]) == [0.8, 0.9]


def test_no_other_process_writes_between_reading_the_tests_and_writing_them(tmp_path, monkeypatch):
    (tmp_path / "pp-p0-vpg-s100").mkdir()
    (tmp_path / "pp-p0-vpg-s100" / records.TRIAL).touch()
    tables.write(made(*seeds("vpg", [0.8], task="pp")), tmp_path)
    missing, real, locks = transfer.untested(tmp_path, tmp_path), held_out.read, []

    def read(folder):
        with pytest.raises(Timeout):
            lock_of(folder / held_out.TABLE).acquire()
        locks.append(folder)
        return real(folder)

    monkeypatch.setattr("usbench.compare.transfer.Setting.prepare_frames", lambda *_: None)
    monkeypatch.setattr(transfer, "test", lambda *_: rows_of(0.1).iloc[0].to_dict())
    monkeypatch.setattr(held_out, "read", read)
    transfer.write(tmp_path, tmp_path, missing)
    held_out.forget(tmp_path, ["pp-p0-vpg-s100"])
    assert len(locks) == 3  # before the tests, after the only one, and when it is forgotten
    lock_of(tmp_path / held_out.TABLE).acquire().lock.release()


def test_an_agent_of_the_same_name_that_is_not_that_of_the_tables_is_not_tested(finished, tmp_path):
    known = collecting.collect(finished.parent)
    curves = known.curves.assign(normalized_score=known.curves["normalized_score"] + 0.1)
    tables.write(tables.Results(known.trials, curves), tmp_path)
    missing = transfer.untested(finished.parent, tmp_path)
    (failure,) = transfer.write(finished.parent, tmp_path, missing)
    assert re.match(f"{finished.name} has .* it is another agent", failure)
    assert held_out.read(tmp_path).empty


def test_the_leaderboard_is_written_though_a_trial_cannot_be_tested(finished, tmp_path, capsys):
    known = collecting.collect(finished.parent)
    curves = known.curves.assign(normalized_score=known.curves["normalized_score"] + 0.1)
    tables.write(tables.Results(known.trials, curves), tmp_path / "leaderboard_files")
    board = tmp_path / "leaderboard.md"
    assert cli.main(["transfer", "--runs", str(finished.parent), "--leaderboard", str(board), "--quiet"]) == 1
    printed = capsys.readouterr()
    assert f"1 of 1 trials cannot be tested, as {finished.name} has" in printed.err
    assert str(board) in printed.out and board.is_file()


def test_trials_that_are_there_are_tested_and_absent_ones_counted(tmp_path):
    told = []
    tables.write(made(*seeds("vpg", [0.8, 0.9, 0.7], task="pp")), tmp_path)
    with pytest.raises(ConfigurationError, match=r"3 of 3 trials .*, as pp-p0-vpg-s100: name the folder"):
        transfer.untested(tmp_path, tmp_path)
    (tmp_path / "pp-p0-vpg-s101").mkdir()
    (tmp_path / "pp-p0-vpg-s101" / records.TRIAL).touch()
    found = transfer.untested(tmp_path, tmp_path, tell=told.append)
    assert list(found["trial"]) == ["pp-p0-vpg-s101"]
    assert told == [
        f"2 of 3 trials to test are not in {str(tmp_path)!r}, as pp-p0-vpg-s100: the others are tested"
    ]


def test_how_long_the_tests_take_is_told(tmp_path, monkeypatch, caplog):
    caplog.set_level(logging.INFO)
    monkeypatch.setattr("usbench.waiting._MEASURED_S", 0.0)
    monkeypatch.setattr("usbench.waiting.LONG_S", 0.0)
    for name in ("pp-p0-vpg-s100", "pp-p0-vpg-s101"):
        (tmp_path / name).mkdir()
        (tmp_path / name / records.TRIAL).touch()
    tables.write(made(*seeds("vpg", [0.8, 0.9], task="pp")), tmp_path)
    monkeypatch.setattr("usbench.compare.transfer.Setting.prepare_frames", lambda *_: None)
    monkeypatch.setattr(transfer, "test", lambda *_: rows_of(0.1).iloc[0].to_dict())
    play(tmp_path)
    assert re.fullmatch(r"Testing agents on unseen phantoms: (less than|about) .*\.", caplog.messages[0])


def test_agents_of_ones_own_are_opened_only_if_they_are_named(tmp_path, monkeypatch):
    own, told, opened = "mine:LongPPO", [], []
    tables.write(made(trial(own, 0.5, task="pp", trial="own")), tmp_path)
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / records.TRIAL).touch()
    monkeypatch.setattr("usbench.compare.transfer.Setting.prepare_frames", lambda *_: None)
    monkeypatch.setattr(
        transfer, "test", lambda trial, algo, score: opened.append(algo) or rows_of(0.1).iloc[0].to_dict()
    )
    play(tmp_path, None, told.append)
    assert told == [f"left out, as testing them runs their code, unless they are named: {own}"] and not opened
    play(tmp_path, [own], told.append)
    assert opened == [own]
    with pytest.raises(ConfigurationError, match="with algo 'vpg', only with 'mine:LongPPO'"):
        transfer.untested(tmp_path, tmp_path, algos=["vpg"])
