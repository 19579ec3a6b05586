"""How good the intervals are: what the simulation draws from, and what it prints."""

import sys

import intervals
import numpy as np
import pytest

from usbench.compare import protocol
from usbench.results import scores


def test_rows_of_the_leaderboard_are_those_of_the_grid_with_all_its_seeds():
    rules = protocol.read().comparison
    matrices = scores.learners(intervals.grid())
    assert {len(matrix) for matrix in matrices.values()} == {rules.seeds}
    drawn = intervals.committed()
    assert set(drawn) == {f"as `{row}`" for row in rules.rows}
    for row, matrix in matrices.items():
        many = drawn[f"as `{row}`"](20_000, np.random.default_rng(0))
        assert many.shape == (20_000, intervals.N_CELLS) and many.max() <= 1
        # What an error takes away at 1 makes the mean a little lower.
        assert many.mean(axis=0) == pytest.approx(matrix.mean(axis=0), abs=0.02)


def test_tables_are_printed_where_nobody_watches(monkeypatch, capsys):
    monkeypatch.setattr(intervals, "TRUTH", 1000)
    monkeypatch.setattr(intervals, "N_RESAMPLES", 100)
    argv = ["intervals.py", "--simulations", "2", "--families", "1", "--scores", "normal", "as `vpg-tuned`"]
    monkeypatch.setattr(sys, "argv", argv)
    intervals.main()
    printed = capsys.readouterr().out
    assert printed.count("hold the truth") == 2 and "equal agents" in printed
    assert "as `vpg-tuned`" in printed and "…" not in printed
