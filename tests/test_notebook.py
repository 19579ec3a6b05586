"""The notebook of the documentation: its code runs from the committed records, whatever they hold."""

import json
from pathlib import Path

import matplotlib
import pytest

from usbench.results import tables
from usbench.results.protocol import further

NOTEBOOK = Path(__file__).parents[1] / "docs" / "records.ipynb"
# Trains an agent: `make docs` runs it.
FIVE_MINUTES = NOTEBOOK.with_name("five_minutes.ipynb")


def cells(kind, notebook=NOTEBOOK):
    return [cell for cell in json.loads(notebook.read_text())["cells"] if cell["cell_type"] == kind]


def test_code_runs_from_the_committed_records(quick, monkeypatch, tmp_path):
    monkeypatch.chdir(NOTEBOOK.parent)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    names = {}
    with matplotlib.rc_context({"backend": "agg"}):
        for cell in cells("code"):
            exec("".join(cell["source"]), names)
        shown = [axis for axis in names["axes"].flat if axis.figure]
        assert len(shown) == len(names["tasks"])
        for axis in shown:
            assert axis.get_xlabel() and axis.get_ylabel() and axis.lines
            # One legend for all panels, below them: inside, it would cover curves.
            assert axis.get_legend() is None
        figure = names["figure"]
        figure.draw_without_rendering()
        (legend,) = figure.legends
        assert [text.get_text() for text in legend.get_texts()] == list(names["lines"])
        assert set(names["lines"]) == set(names["greedy"]["algo"])
        top = legend.get_window_extent().y1
        assert all(axis.get_tightbbox().y0 >= top for axis in shown)
        assert legend.get_window_extent().width <= figure.bbox.width
        names["plt"].close("all")
    assert not names["scores"].empty and names["scores"]["normalized_score"].between(-1, 1.2).all()
    known = tables.read(Path(__file__).parents[1] / "leaderboard_files")
    single_frames = further.split(known)["single-frames"].trials["trial"]
    learned = names["scores"].merge(names["results"].trials[["trial", "steps"]]).query("steps > 0")
    learned = learned[learned["task"].isin(("fp", "pp"))]
    assert len(learned) and not learned["trial"].isin(single_frames).any()
    assert set(names["evaluations"]["algo"]) == {"random"}
    assert names["state"].status == "finished"


@pytest.mark.parametrize("cell", [*cells("code"), *cells("code", FIVE_MINUTES)])
def test_it_is_committed_without_outputs_that_would_grow_old(cell):
    assert cell["outputs"] == [] and cell["execution_count"] is None
