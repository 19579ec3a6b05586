"""The figure of docs/physics.md that shows how a point looks: see benchmarks/figures.py."""

import importlib
from pathlib import Path

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg


@pytest.fixture
def figures(monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "benchmarks"))
    return importlib.import_module("figures")


def test_legend_lies_outside_all_panels(figures, monkeypatch):
    monkeypatch.setattr(figures, "profile", lambda *_: np.ones(len(figures.OFFSETS)))
    monkeypatch.setattr(figures, "point_image", lambda *_: None)
    figure = figures.point_response(figures.references())
    FigureCanvasAgg(figure).draw()
    (legend,) = figure.legends
    assert not any(axes.get_legend() for axes in figure.axes)
    assert not any(axes.bbox.overlaps(legend.get_window_extent()) for axes in figure.axes)


def test_a_point_is_summed_with_the_table_as_frames_are(figures, monkeypatch):
    def refused(*_):
        raise AssertionError

    monkeypatch.setattr("usbench.envs.rf.add_echoes", refused)
    envelope, time = figures.point(0.0, 20e-3, 20e-3, [0.0])
    assert envelope.shape == (len(time), 1) and envelope.max() > 0
