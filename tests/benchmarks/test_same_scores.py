"""Agents of plain scripts are scored, once, and compared with the leaderboard's as samples."""

import dataclasses
import sys
from pathlib import Path

import pytest
import same_scores
from made_tables import made, seeds

from usbench.results import tables
from usbench.tasks import row_of

STEPS = 32
DOCS = Path(__file__).parents[2] / "docs" / "comparison.md"


@pytest.fixture
def grid(monkeypatch, tmp_path):
    """A leaderboard of four trials, no rows yet of plain scripts, and a short budget."""
    results = made(*seeds("vpg", [0.25, 0.75], steps=STEPS), *seeds("a2c", [0.5, 0.5], steps=STEPS))
    tables.write(results, tmp_path)
    monkeypatch.setattr(same_scores, "GRID", tmp_path)
    monkeypatch.setattr(same_scores, "ROWS", tmp_path / "plain.csv")
    monkeypatch.setattr(same_scores, "SEEDS", range(2))
    monkeypatch.setattr(same_scores, "row_of", lambda task: dataclasses.replace(row_of(task), steps=STEPS))


# Agents that learned nothing score the same.
@pytest.mark.filterwarnings("ignore:Precision loss")
def test_agents_of_plain_scripts_are_trained_once_and_compared(quick, grid, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["same_scores.py", "--algos", "vpg", "a2c"])
    same_scores.main()
    rows = same_scores.known()
    assert [(row["algo"], row["seed"]) for row in rows] == [
        (algo, seed) for algo in ("vpg", "a2c") for seed in "01"
    ]
    assert {row["steps"] for row in rows} == {str(STEPS)}
    capsys.readouterr()
    same_scores.main()
    shown = capsys.readouterr().out
    assert same_scores.known() == rows and "of 4:" not in shown
    assert "0.500 (0.250 to 0.750, 2)" in shown and "0.500 (0.500 to 0.500, 2)" in shown


def test_scores_of_the_leaderboard_are_those_of_the_algorithms_row(grid):
    assert same_scores.of_leaderboard("fp", STEPS) == {"vpg": [0.25, 0.75], "a2c": [0.5, 0.5]}
    assert same_scores.of_leaderboard("pp", STEPS) == {}
    assert same_scores.of_leaderboard("fp", STEPS + 1) == {}


def test_docs_show_what_the_committed_rows_say():
    shown = DOCS.read_text().splitlines()
    for algo, *words in same_scores.compared("fp", row_of("fp").steps):
        assert f"| {' | '.join([f'`{algo}`', *words])} |" in shown


def test_differences_have_welchs_interval():
    # Student's interval, since variances and sizes are equal: t(0.975, 2) = 4.3027.
    assert same_scores.difference([0.0, 1.0], [1.0, 2.0]) == "+1.000 [-2.042, +4.042]"
