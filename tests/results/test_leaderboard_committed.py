"""The leaderboard at the top of the repository is what its committed tables give, to the byte."""

import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

from usbench.compare import plan, protocol, rest
from usbench.figures import comparison, tuning
from usbench.results import collecting, leaderboard, tables
from usbench.results.protocol import further
from usbench.results.protocol import tuning as searched

TOP = Path(__file__).parents[2]


# That of the whole, and those that `usbench compare` writes apart.
BOARDS = [TOP / "leaderboard.md", *sorted((TOP / "tables").glob("*/leaderboard.md"))]
EACH = pytest.mark.parametrize("board", BOARDS, ids=lambda board: str(board.relative_to(TOP)))


@EACH
def test_committed_leaderboard_comes_from_the_committed_tables(board, tmp_path):
    # `usbench compare` writes them, `usbench leaderboard` writes them again.
    written = leaderboard.write(leaderboard.files(board), tmp_path / "leaderboard.md")
    assert {path.name for path in written} >= {"leaderboard.md", "scores.csv"}
    for path in written:
        assert path.read_bytes() == (board.parent / path.name).read_bytes(), path.name


@EACH
def test_committed_figures_come_from_the_committed_tables(board, tmp_path):
    # With the versions of constraints.txt: another matplotlib draws otherwise.
    folder = leaderboard.files(board)
    comparison.write(tables.read(folder), tmp_path)
    tuning.write(searched.read(folder), tmp_path)
    committed, drawn = (
        {path.name: path.read_bytes() for path in place.glob("*.png")} for place in (folder, tmp_path)
    )
    assert sorted(committed) == sorted(drawn)
    assert [name for name, content in committed.items() if drawn[name] != content] == []


def test_page_on_the_paper_comes_from_the_committed_tables(tmp_path):
    # `make paper` writes it, and `make leaderboard` does.
    command = [sys.executable, TOP / "benchmarks" / "paper.py", "--out", tmp_path / "paper.md"]
    subprocess.run(command, check=True, capture_output=True)
    written = sorted(path.name for path in tmp_path.iterdir())
    assert written == ["paper.md", "paper_figure4.png", "paper_figure5.png"]
    for name in written:
        assert (TOP / "docs" / name).read_bytes() == (tmp_path / name).read_bytes(), name


def test_trials_of_the_committed_leaderboard_have_the_names_that_they_always_had(tmp_path):
    # A setting that is new changes no name where it is off: what was run is not run again.
    trials = pd.read_csv(TOP / "leaderboard_files" / "trials.csv", dtype={"configuration": str})
    trials = trials.set_index("trial")
    planned = [config for config in plan.by_protocol(protocol.read()) if config.steps]
    assert {config.folder_name for config in planned} <= set(trials.index)
    ours = collecting.collect(tmp_path, planned).trials.set_index("trial")[["configuration", "settings"]]
    assert ours.equals(trials.loc[ours.index, ["configuration", "settings"]])


def test_trials_of_further_tables_have_the_names_that_they_always_had(tmp_path):
    rules, folder = protocol.read(), TOP / "leaderboard_files"
    there = further.split(tables.read(folder))
    for extra in rules.comparison.extras:
        # `other-tasks` differs from the grid in its tasks alone, and stands beside it.
        own = there.get(extra.name, there["grid"] if extra.rows else None)
        if own is None:
            continue
        planned = plan.by_protocol(
            rules, extra.name, algos=rest.rows(rules, extra.name, tmp_path / "runs", folder)
        )
        names = {config.folder_name for config in planned if config.steps}
        known = set(own.trials.loc[own.trials["steps"] > 0, "trial"])
        assert names <= known if extra.rows else known <= names


def test_committed_tables_are_read_and_written_without_a_change(tmp_path):
    folder = leaderboard.files(TOP / "leaderboard.md")
    for path in tables.write(tables.read(folder), tmp_path):
        assert path.read_bytes() == (folder / path.name).read_bytes()
