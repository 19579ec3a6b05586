"""usbench plot: figures from any set of trials, each counted once."""

import re
import shutil

import pandas as pd
import pytest
from made_tables import made, seeds
from matplotlib.backends.backend_agg import FigureCanvasAgg
from state_files import read_state, write_state

from usbench import cli, records
from usbench.figures import comparison, plots, style
from usbench.records import ConfigurationError
from usbench.results import sources, tables
from usbench.results.protocol import tuning as searched


def test_one_trial_in_every_format(finished, tmp_path, capsys):
    out = tmp_path / "new" / "figures"
    assert cli.main(["plot", str(finished), "--out", str(out), "--format", "png", "svg", "pdf"]) == 0
    shown = capsys.readouterr().out.splitlines()
    names = [f"learning_curve_{finished.name}", "scores", "learning_curves", "learning_curves_cpu"]
    names += ["performance_profiles"]
    names += ["figure4", "figure5"]
    assert shown == [str(out / f"{name}.{kind}") for name in names for kind in ("png", "svg", "pdf")]
    starts = {"png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}
    assert all((out / path).read_bytes().startswith(starts[path.rsplit(".")[-1]]) for path in shown)


def test_figures_are_those_of_the_leaderboard_and_learning_curves_only_of_named_trials(tmp_path):
    known = made(*seeds("vpg", [0.2, 0.4]), *seeds("ppo", [0.5, 0.7]))
    tables.write(known, tmp_path / "tables")
    drawn = plots.write([tmp_path / "tables"], tmp_path / "a", ["svg"])
    expected = comparison.write(known, tmp_path / "b", ["svg"])
    assert [path.name for path in drawn] == [path.name for path in expected]
    assert [path.read_bytes() for path in drawn] == [path.read_bytes() for path in expected]


def test_a_format_that_is_named_twice_is_drawn_once(finished, tmp_path, capsys):
    assert cli.main(["plot", str(finished), "--out", str(tmp_path), "--format", "png", "svg", "png"]) == 0
    shown = capsys.readouterr().out.splitlines()
    assert len(shown) == len(set(shown)) and {path[-4:] for path in shown} == {".png", ".svg"}


def test_trials_of_one_name_have_one_learning_curve_that_of_the_last(finished, tmp_path):
    copy = shutil.copytree(finished, tmp_path / "copy" / finished.name)
    assert [trial.folder for trial in plots._single([finished, copy], True)] == [copy]
    write_state(copy, read_state(copy) | {"status": "running"})
    assert [trial.folder for trial in plots._single([copy, finished, copy], True)] == [finished]
    drawn = plots.write([finished, copy], tmp_path / "figures")
    assert len(drawn) == len(set(drawn))


def test_each_search_has_a_figure_and_the_same_search_one(tmp_path):
    trials, columns = made(*seeds("vpg", [0.2, 0.4])), list(searched.COLUMNS)
    for folder, scores in {"a": [0.1, 0.3], "b": [0.2, 0.4], "c": [0.1, 0.3]}.items():
        tables.write(trials, tmp_path / folder)
        rows = [["vpg", candidate, "fp", 0.0, 1000, score, 0] for candidate, score in enumerate(scores)]
        searched.write(pd.DataFrame(rows, columns=columns), tmp_path / folder)
    drawn = plots.write([tmp_path / folder for folder in "abc"], tmp_path / "figures")
    first, second = (path for path in drawn if path.stem.startswith("tuning"))
    assert (first.name, second.name) == ("tuning.png", "tuning_2.png")
    assert first.read_bytes() != second.read_bytes()


def test_a_trial_counts_once_and_others_beside_it_do_not(finished):
    other = finished.with_name("pp-p0.5-vpg-s1-00000000")
    shutil.copytree(finished, other)
    state = read_state(other)
    state["config"]["seed"] = 1
    write_state(other, state)
    alone = sources.gather([finished, finished])
    assert list(alone.trials["trial"]) == [finished.name]
    both = sources.gather([finished, finished.parent])
    assert sorted(both.trials["seed"]) == [0, 1]
    assert len(both.curves) == 2 * len(alone.curves)


def test_a_damaged_trial_is_left_out_and_the_others_are_drawn(finished, tmp_path, capsys):
    broken = shutil.copytree(finished, finished.with_name("pp-p0.5-vpg-s1-00000000"))
    state = read_state(broken)
    state["config"]["seed"] = 1
    write_state(broken, state)
    (broken / "evaluations.jsonl").write_text("{}\n")
    assert cli.main(["plot", str(finished), str(broken), "--out", str(tmp_path / "drawn")]) == 0
    shown = capsys.readouterr()
    assert f"learning_curve_{finished.name}.png" in shown.out and broken.name not in shown.out
    assert f"left out: {broken}" in shown.err


def test_a_trial_whose_first_evaluation_is_torn_is_left_out(finished, tmp_path, capsys):
    torn = shutil.copytree(finished, finished.with_name("pp-p0.5-vpg-s1-00000000"))
    state = read_state(torn)
    state["status"], state["config"]["seed"] = "running", 1
    write_state(torn, state)
    (torn / "evaluations.jsonl").write_text('{"episode": 0, "re')
    assert cli.main(["plot", str(finished), str(torn), "--out", str(tmp_path / "drawn")]) == 0
    shown = capsys.readouterr().out
    assert f"learning_curve_{finished.name}.png" in shown and torn.name not in shown


def test_a_folder_that_cannot_be_written_is_refused_before_the_work(finished, tmp_path, monkeypatch):
    def refuse(**_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(records.folder.tempfile, "TemporaryFile", refuse)
    said = f"the folder '{tmp_path}' cannot be written (Permission denied): choose another folder."
    with pytest.raises(ConfigurationError, match=re.escape(said)):
        style.check_file(tmp_path / "report.html", [".html"])
    with pytest.raises(ConfigurationError, match=re.escape(said)):
        plots.write([finished], tmp_path)


def test_a_folder_is_no_file_to_write(tmp_path):
    (tmp_path / "report.html").mkdir()
    with pytest.raises(ConfigurationError, match="report.html', which is a folder: choose another name"):
        style.check_file(tmp_path / "report.html", [".html"])


def test_trial_that_still_runs_has_a_learning_curve_alone(finished, tmp_path):
    state = read_state(finished) | {"status": "running"}
    write_state(finished, state)
    drawn = plots.write([finished], tmp_path)
    assert [path.name for path in drawn] == [f"learning_curve_{finished.name}.png"]


def test_long_names_stay_within_the_figure():
    known = made(*(row for k in range(4) for row in seeds(f"my_module.MyAlgorithm{k}", [0.2, 0.4])))
    figure = comparison.draw(known)["learning_curves"]
    FigureCanvasAgg(figure).draw()
    box = figure.legends[0].get_window_extent()
    assert box.x0 >= 0 and box.x1 <= figure.bbox.x1


@pytest.mark.parametrize(
    ("argv", "said"),
    [
        (["nowhere"], "there is no folder 'nowhere' with trials."),
        (["publishd"], "there is no folder 'publishd' with trials (did you mean 'published'?)."),
        (["afile.txt"], "'afile.txt' is a file, not a folder with trials"),
        (["."], "no finished trial to draw in '.'"),
        ([".", "--format", "bmp"], "png, svg, pdf, not 'bmp'"),
        ([".", "--out"], "--out"),
    ],
)
def test_what_cannot_be_drawn_is_refused(tmp_path, monkeypatch, capsys, argv, said):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "afile.txt").touch()
    assert cli.main(["plot", *argv]) == 2
    captured = capsys.readouterr()
    assert said in captured.err and captured.err.count("\n") == 1 and captured.out == ""


def test_folder_that_cannot_be_made_is_refused(finished, tmp_path, capsys):
    (tmp_path / "file").write_text("")
    assert cli.main(["plot", str(finished), "--out", str(tmp_path / "file")]) == 2
    assert f"'{tmp_path / 'file'}' is a file): choose another folder." in capsys.readouterr().err
    name = "n" * 300
    assert cli.main(["plot", str(finished), "--out", str(tmp_path / name)]) == 2
    assert "cannot be written (File name too long): choose another folder." in capsys.readouterr().err
