"""The CSV of trials: rows are added, replaced and kept; intervals are those of the leaderboard."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from unseen_phantoms import trial_table
from unseen_phantoms.trial_table import Row

from usbench.results import scores

ROW = Row("gap", "double_dqn", 20, 50_000, 0, "ab12", 0.91234567, 0.5, 12.34)
UNLIMITED = replace(ROW, phantoms=None, digest="", unseen=0.7)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "unseen.csv"


def test_a_missing_file_has_no_rows(path):
    assert trial_table.read(path).empty
    assert list(trial_table.read(path).columns) == trial_table.COLUMNS


def test_a_file_is_small_and_says_what_it_holds(path):
    trial_table.add(path, UNLIMITED)
    trial_table.add(path, ROW)
    assert path.read_text() == (
        "table,variant,phantoms,steps,seed,digest,known,unseen,minutes\n"
        "gap,double_dqn,20,50000,0,ab12,0.9123,0.5,12.3\n"
        "gap,double_dqn,,50000,0,,0.9123,0.7,12.3\n"
    )


def test_the_order_in_which_rows_are_added_does_not_matter(path, tmp_path):
    rows = [
        replace(one, seed=seed, table=table) for one in (ROW, UNLIMITED) for seed in (1, 0) for table in "ba"
    ]
    other = tmp_path / "other.csv"
    for row in rows:
        trial_table.add(path, row)
    for row in reversed(rows):
        trial_table.add(other, row)
    assert path.read_bytes() == other.read_bytes()


@pytest.mark.parametrize("row", [ROW, UNLIMITED])
def test_a_row_of_the_same_trial_is_replaced_and_others_stay(path, row):
    others = [
        replace(row, **change)
        for change in ({"table": "x"}, {"variant": "distilled"}, {"phantoms": 3}, {"steps": 9}, {"seed": 7})
    ]
    for one in (*others, row, replace(row, unseen=0.25, minutes=3.0, digest="cd34")):
        trial_table.add(path, one)
    rows = trial_table.read(path)
    assert len(rows) == len(others) + 1
    (own,) = rows[rows["unseen"] == 0.25].to_dict("records")
    assert own["minutes"] == 3.0 and own["digest"] == "cd34"


def test_a_file_with_other_columns_is_refused(path):
    path.write_text("table,variant\ngap,dqn\n")
    with pytest.raises(ValueError, match=r"must have the columns table, variant, .*, not table, variant\."):
        trial_table.read(path)


def test_intervals_are_those_of_the_leaderboard(path):
    values = [0.5, 0.9, 0.6]
    for seed, value in enumerate(values):
        trial_table.add(path, replace(ROW, seed=seed, unseen=value, minutes=float(seed)))
    trial_table.add(path, UNLIMITED)
    several, single = trial_table.intervals(trial_table.read(path)).to_dict("records")
    expected = scores.score_of(np.reshape(values, (-1, 1)))
    assert (several["phantoms"], several["seeds"], several["minutes"]) == (20, 3, 1.0)
    for name, value in expected.items():
        assert several[name.replace("score", "unseen")] == value
    assert pd.isna(single["phantoms"]) and np.isnan(single["unseen_low"]) and single["unseen"] == 0.7


def test_a_printed_table_has_intervals_where_there_are_several_seeds(path):
    for seed, value in enumerate([0.5, 0.9]):
        trial_table.add(path, replace(ROW, seed=seed, unseen=value))
    trial_table.add(path, UNLIMITED)
    table = trial_table.printed(trial_table.read(path), "gap")
    cells = {column.header: list(column.cells) for column in table.columns}
    assert cells["training phantoms"] == ["20 (set ab12)", "no limit"]
    assert cells["unseen"] == ["0.70 [0.50, 0.90]", "0.70"]
    assert cells["seeds"] == ["2", "1"]
