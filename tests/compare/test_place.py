"""Where a leaderboard goes: never in the place of trials that are nowhere else."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pandas as pd
import pytest
from made_tables import made, seeds, trial

from usbench import cli
from usbench.compare import runs, sweep
from usbench.results import additions, held_out, studies, tables

BOARD, TRIALS = Path("leaderboard.md"), Path("leaderboard_files") / tables.TRIALS
TINY = ["--algos", "random", "--tasks", "pp", "--noise", "0.5", "--seeds", "1", "--jobs", "1", "--quiet"]
COMPARE = ["compare", *TINY]


@pytest.fixture
def board(quick, tmp_path, monkeypatch):
    """A folder with the tables of a leaderboard that has one trial; returns the trial's name."""
    monkeypatch.setitem(sweep.run.__kwdefaults__, "executor", lambda: ThreadPoolExecutor(1))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("usbench.figures.comparison.write", lambda *_: [])  # most of the time
    TRIALS.parent.mkdir()
    known = made(trial("vpg"))
    tables.write(known, TRIALS.parent)
    return known.trials["trial"].item()


def test_trials_that_are_nowhere_else_keep_their_leaderboard(board):
    assert runs.place(BOARD, Path("runs"), ["other"]) == Path("runs/leaderboard.md")


def test_trials_that_are_there_or_that_are_read_do_not_count(board):
    assert runs.place(BOARD, Path("runs"), [board, "other"]) == BOARD
    (Path("runs") / board).mkdir(parents=True)
    assert runs.place(BOARD, Path("runs"), ["other"]) == BOARD


@pytest.mark.parametrize("changes", [{"status": "missing"}, {"status": "failed"}, {"steps": 0}])
def test_what_was_not_trained_cannot_be_lost(board, changes):
    tables.write(made(trial("vpg", **changes)), TRIALS.parent)
    assert runs.place(BOARD, Path("runs"), []) == BOARD


def test_broken_tables_hold_nothing(board):
    TRIALS.write_text("nothing\n")
    assert runs.place(BOARD, Path("runs"), []) == BOARD


@pytest.mark.parametrize("own", ["leaderboard.md", "scores.csv"])
def test_a_users_own_file_of_this_name_is_left_alone(board, own):
    Path(own).write_text("mine\n")
    told = []
    assert runs.place(BOARD, Path("runs"), [board], told.append) == Path("runs/leaderboard.md")
    assert told == [f"{own} is not of usbench: this leaderboard goes to runs/leaderboard.md"]
    assert runs.place(BOARD, Path("runs"), [board], named=BOARD) == BOARD


def test_studies_that_are_nowhere_else_keep_a_leaderboard_that_would_lose_them(board):
    row = {name: 1.0 for name in studies.COLUMNS} | {
        "study": "anna",
        "task": "pp",
        "agent": "a",
        "player": "human",
    }
    studies.write(pd.DataFrame([row]), TRIALS.parent)
    elsewhere = Path("runs/leaderboard.md")
    assert runs.place(BOARD, Path("runs"), [board]) == BOARD
    assert runs.place(BOARD, Path("runs"), [board], with_studies=True) == elsewhere
    studies.folder_of(Path("runs"), "anna").mkdir(parents=True)
    assert runs.place(BOARD, Path("runs"), [board], with_studies=True) == BOARD


def test_what_was_trained_anew_loses_its_tests_and_its_mark(board):
    names = [f"fp-p0-vpg-s{seed}" for seed in (100, 101)]
    for folder, second in ((new := Path("new"), 0.9), (Path("old"), 0.5)):
        folder.mkdir()
        tables.write(made(*seeds("vpg", [0.4, second])), folder)
    tested = pd.DataFrame(
        [{**dict.fromkeys(held_out.COLUMNS, 1.0), "trial": name, "task": "fp-random"} for name in names]
    )
    held_out.write(tested, folder)
    additions.mark_unverified(folder, names, names)
    runs.write_tables(tables.read(new), folder)
    assert list(held_out.read(folder)["trial"]) == names[:1] == additions.unverified(folder)


def test_commands_leave_the_leaderboard_alone_and_say_where_theirs_is(board, capsys):
    before = TRIALS.read_bytes()
    for command in (COMPARE, ["leaderboard", "--runs", "runs"]):
        assert cli.main(command) == 0
        said = capsys.readouterr()
        assert said.err.splitlines()[-1] == (
            "leaderboard.md holds trials or studies that are not in runs: this leaderboard goes to "
            "runs/leaderboard.md"
        )
        assert said.out.splitlines()[0] == "runs/leaderboard.md"
        assert TRIALS.read_bytes() == before and not BOARD.exists()
    assert set(tables.read(Path("runs/leaderboard_files")).trials["algo"]) == {"random", "stay", "oracle"}


def test_commands_write_the_leaderboard_that_is_named_and_say_what_it_loses(board, capsys):
    assert cli.main([*COMPARE, "--leaderboard", "leaderboard.md"]) == 0
    assert capsys.readouterr().err == (
        "leaderboard.md holds trials or studies that are not in runs: this leaderboard takes their place\n"
    )
    assert board not in set(tables.read(TRIALS.parent).trials["trial"])


def test_a_leaderboard_of_what_is_finished_needs_a_folder_of_trials(board, capsys):
    assert cli.main([*COMPARE, "--report-only", "--out", "nothere"]) == 2
    assert "'nothere'" in capsys.readouterr().err and not Path("nothere").exists()


def test_a_trial_that_left_the_tables_and_comes_back_loses_its_test(board):
    folder = Path("old")
    folder.mkdir()
    one, other = made(*seeds("vpg", [0.4])), made(*seeds("ppo", [0.5]))
    tables.write(one, folder)
    name = one.trials["trial"][0]
    row = {**dict.fromkeys(held_out.COLUMNS, 1.0), "trial": name, "task": "fp-random"}
    held_out.write(pd.DataFrame([row]), folder)
    runs.write_tables(other, folder)
    runs.write_tables(made(*seeds("vpg", [0.2])), folder)
    assert held_out.read(folder).empty
