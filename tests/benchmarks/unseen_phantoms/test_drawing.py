"""The figures of known and unseen phantoms, from rows of the CSV alone."""

from dataclasses import replace

import numpy as np
import pytest
from unseen_phantoms import drawing, trial_table
from unseen_phantoms.trial_table import Row

from usbench.figures import looks

ROW = Row("gap", "double_dqn", 1, 50_000, 0, "ab12", 0.9, 0.1, 12.0)


@pytest.fixture
def rows(tmp_path):
    """Rows of two agents, three sets of phantoms and two seeds, and of a scaling with a single seed."""
    path = tmp_path / "unseen.csv"
    for algo in ("double_dqn", "distilled"):
        for place, count in enumerate((None, 2000, 1)):
            for seed in (0, 1):
                one = replace(
                    ROW, variant=algo, phantoms=count, seed=seed, unseen=0.5 - 0.3 * place + 0.1 * seed
                )
                trial_table.add(path, one)
    trial_table.add(path, replace(ROW, steps=64, unseen=-5.0))
    for steps, value in ((1_000_000, 0.9), (100_000, 0.7)):
        trial_table.add(path, replace(ROW, table="scaling", phantoms=None, steps=steps, unseen=value))
    return trial_table.read(path)


def test_figures_are_written_for_the_tables_that_have_rows(rows, tmp_path):
    files = drawing.write(rows, tmp_path)
    assert [file.name for file in files] == ["unseen_gap.png", "unseen_scaling.png"]
    before = [file.read_bytes() for file in files]
    assert [file.read_bytes() for file in drawing.write(rows, tmp_path)] == before
    assert drawing.write(rows[rows["table"] == "ablations"], tmp_path) == []


def test_the_gap_has_a_panel_per_agent_and_no_limit_comes_last(rows):
    figure = drawing.gap(rows[rows["table"] == "gap"])
    assert [axis.get_title() for axis in figure.axes] == ["distilled", "double_dqn"]
    axis = figure.axes[1]
    assert [label.get_text() for label in axis.get_xticklabels()] == ["1", "2 000", "no limit"]
    unseen, known = axis.get_lines()[:2]
    # The two seeds lie around it; the row with fewer steps is not drawn.
    np.testing.assert_allclose(unseen.get_ydata(), [-0.05, 0.25, 0.55])
    np.testing.assert_allclose(known.get_ydata(), [0.9] * 3)
    look = looks.agents(["double_dqn"])["double_dqn"]
    assert all(
        (one.get_color(), one.get_marker()) == (look["color"], look["marker"]) for one in (unseen, known)
    )
    low, high = axis.collections[0].get_datalim(axis.transData).get_points()[:, 1]
    np.testing.assert_allclose((low, high), (-0.1, 0.6))
    assert axis.get_ylim()[0] < -0.1


def test_the_scaling_has_a_logarithmic_axis_and_no_band_for_a_single_seed(rows):
    axis = drawing.scaling(rows[rows["table"] == "scaling"]).axes[0]
    unseen = axis.get_lines()[0]
    np.testing.assert_allclose(unseen.get_xdata(), [5, 6])
    np.testing.assert_allclose(unseen.get_ydata(), [0.7, 0.9])
    assert [label.get_text() for label in axis.get_xticklabels()] == ["100 000", "1 000 000"]
    assert axis.figure.get_suptitle() == "pp-tracked, greedy actions: a single seed"
