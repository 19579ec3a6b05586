"""The program behind `make unseen`: what it trains, keeps, prints and draws."""

import multiprocessing
import shutil
import sys
from dataclasses import replace
from functools import partial

import children
import numpy as np
import pytest
import sweep_worker
import unseen
from unseen_phantoms import drawing, measuring, trial_table
from unseen_phantoms.studies import STUDIES, Variant

from usbench.compare import sweep
from usbench.records import Trial
from usbench.trials import runner

# Episodes of 16 steps, of which each of four environments ends one.
STEPS = 100


@pytest.fixture
def call(monkeypatch, tmp_path):
    """Run the program with some options, all it writes in a folder of the test."""

    def called(*options):
        files = ["--out", str(tmp_path / "runs"), "--csv", str(tmp_path / "unseen.csv")]
        monkeypatch.setattr(sys, "argv", ["unseen.py", *files, *map(str, options)])
        unseen.main()
        return trial_table.read(tmp_path / "unseen.csv")

    return called


@pytest.fixture
def small(quick, monkeypatch):
    """A study of two variants, one of them on a fixed set of phantoms, whose trials are quick."""
    # Workers that are forked from a process that has imported everything: spawned ones import for seconds.
    monkeypatch.setattr(multiprocessing, "get_context", lambda _: children.CONTEXT)
    executor = partial(sweep.processes, sweep_worker.quick)
    monkeypatch.setattr(unseen.sweep, "run", partial(sweep.run, executor=executor))
    variants = (Variant("b"), Variant("a", setting={"n_phantoms": 2}))
    study = replace(STUDIES["gap"], variants=variants, steps=(STEPS,), n_seeds=2)
    monkeypatch.setitem(unseen.STUDIES, "gap", study)
    return study


def test_trials_are_run_once_and_printed_in_the_order_of_the_study(small, call, capsys, tmp_path):
    rows = call("--tables", "gap")
    assert len(rows) == 4 and set(rows["steps"]) == {STEPS}
    printed = capsys.readouterr().out
    assert printed.index("│ b ") < printed.index("│ a ") and "2 (set " in printed
    models = sorted((tmp_path / "runs").glob("*/model.zip"))
    before = [model.stat().st_mtime_ns for model in models]
    assert len(models) == 4
    assert call("--tables", "gap").equals(rows)
    assert [model.stat().st_mtime_ns for model in models] == before


def test_what_stands_in_the_csv_is_not_trained_again(small, call, monkeypatch, tmp_path):
    rows = call("--tables", "gap", "--rows", "b", "--seeds", 1)
    assert list(rows["variant"]) == ["b"]
    shutil.rmtree(tmp_path / "runs")
    # The same trial has another title in another table.
    study = replace(small, variants=(Variant("as it is"), Variant("one frame", setting={"n_frames": 1})))
    monkeypatch.setitem(unseen.STUDIES, "ablations", study)
    shared = call("--tables", "gap", "ablations", "--rows", "b", "as it is", "--seeds", 1)
    assert not list((tmp_path / "runs").glob("*/model.zip"))
    assert list(shared["table"]) == ["ablations", "gap"] and set(shared["variant"]) == {"as it is", "b"}
    assert (
        shared.drop(columns=["table", "variant"])
        .drop_duplicates()
        .equals(rows.drop(columns=["table", "variant"]))
    )


def test_ctrl_c_loses_no_finished_trial(small, call, monkeypatch, tmp_path):
    def measured(table, variant, trial):
        if trial.config.seed == 1:
            raise KeyboardInterrupt
        return trial_table.Row(table, variant.title, None, STEPS, 0, "", 0.5, 0.5, 1.0)

    monkeypatch.setattr(unseen, "measured", measured)
    with pytest.raises(SystemExit, match="the same command goes on from here"):
        call("--tables", "gap", "--jobs", 1)
    # All variants of the first seed come before the second seed.
    rows = trial_table.read(tmp_path / "unseen.csv")
    assert sorted(rows["variant"]) == ["a", "b"] and set(rows["seed"]) == {0}


def test_a_damaged_trial_is_told_after_the_others_are_added(small, call, tmp_path):
    call("--tables", "gap", "--seeds", 1)
    damaged, *_ = (tmp_path / "runs").glob("*/model.zip")
    damaged.write_bytes(b"nothing")
    (tmp_path / "unseen.csv").unlink()
    with pytest.raises(SystemExit, match="failed: .*model.zip.*the same command tries again"):
        call("--tables", "gap", "--seeds", 1)
    assert len(trial_table.read(tmp_path / "unseen.csv")) == 1


def test_figures_are_drawn_without_training(call, monkeypatch, tmp_path, capsys):
    row = trial_table.Row("scaling", "double_dqn", None, 100_000, 0, "", 0.5, 0.5, 1.0)
    with pytest.raises(SystemExit):
        call("--figures", tmp_path)
    assert "train first, without --figures" in capsys.readouterr().err
    trial_table.add(tmp_path / "unseen.csv", row)
    monkeypatch.setattr(unseen, "measured", None)
    call("--figures", tmp_path)
    assert capsys.readouterr().out.split() == [str(tmp_path / "unseen_scaling.png")]
    assert (tmp_path / "unseen_scaling.png").exists()


@pytest.mark.parametrize(
    ("option", "value", "said"),
    [
        ("--jobs", 0, "jobs must be a whole number from 1, not 0"),
        ("--seeds", 0, "seeds must be a whole number from 1, not 0"),
        ("--seeds", -1, "seeds must be a whole number from 1, not -1"),
        ("--steps", 0, "steps must be a whole number from 1, not 0"),
        ("--steps", 8, "steps must be at least 128, an episode in each of 8 environments, not 8"),
    ],
)
def test_numbers_that_train_nothing_are_refused(call, capsys, option, value, said):
    with pytest.raises(SystemExit):
        call("--tables", "gap", option, value)
    assert f"error: {said}" in capsys.readouterr().err


def test_rows_that_no_table_has_are_refused(call, capsys):
    with pytest.raises(SystemExit):
        call("--tables", "ablations", "--rows", "no norms")
    told = capsys.readouterr().err
    assert "error: unknown row 'no norms' (did you mean 'no norm'?): allowed are 'as it is'," in told


def test_seeds_of_comparisons_are_refused(call, capsys):
    with pytest.raises(SystemExit):
        call("--tables", "scaling", "--seeds", 11)
    assert "error: a development takes seeds 0 to 9, not 10" in capsys.readouterr().err


def shown(row):
    """A row's two scores with their intervals, as the docs have them."""
    return [
        f"{row[score]:.2f} [{row[f'{score}_low']:.2f}, {row[f'{score}_high']:.2f}]"
        for score in ("known", "unseen")
    ]


def test_docs_show_what_the_committed_trials_say(tmp_path):
    rows = trial_table.read(unseen.DOCS / "unseen.csv")
    text = (unseen.DOCS / "agents.md").read_text()
    points = trial_table.intervals(rows[rows["table"] == "gap"]).astype({"phantoms": float})
    for count, own in points.groupby("phantoms", dropna=False):
        cells = [
            cell
            for row in own.sort_values("variant", ascending=False).to_dict("records")
            for cell in shown(row)
        ]
        named = "no limit" if np.isnan(count) else f"{count:,.0f}".replace(",", " ")
        assert f"| {named} | {' | '.join(cells)} |" in text
    ablations = trial_table.intervals(rows[rows["table"] == "ablations"])
    assert (ablations["seeds"] == STUDIES["ablations"].n_seeds).all()
    for row in ablations.to_dict("records"):
        title = "nothing" if row["variant"] == "as it is" else row["variant"]
        assert f"| {title} | {' | '.join(shown(row))} |" in text
    scaling = trial_table.intervals(rows[rows["table"] == "scaling"])
    assert (scaling["seeds"] == STUDIES["scaling"].n_seeds).all()
    for row in scaling.to_dict("records"):
        steps = f"{row['steps']:,}".replace(",", " ")
        assert f"| {steps} | {' | '.join(shown(row))} | {row['minutes']:.0f} |" in text
    for path in drawing.write(rows, tmp_path):
        assert path.read_bytes() == (unseen.DOCS / path.name).read_bytes()


def test_the_scaling_is_that_of_one_agent():
    assert STUDIES["scaling"].steps == (100_000, 300_000, 1_000_000)
    (only,) = STUDIES["scaling"].variants
    assert only.config(1_000_000, seed=0).n_envs == 32


@pytest.mark.parametrize("count", [2, None])
def test_known_phantoms_are_those_that_were_met(quick, monkeypatch, tmp_path, count):
    variant = Variant("a", setting={"n_phantoms": count})
    trial = Trial.read(runner.run_trial(variant.config(STEPS, seed=0), tmp_path).folder)
    met = set(trial.episodes()["phantom"])
    played = []

    class Watched(measuring.Evaluator):
        def __init__(self, setting, episodes):
            played.extend(one.phantom for one in episodes)
            super().__init__(setting, episodes)

    monkeypatch.setattr(measuring, "Evaluator", Watched)
    assert np.isfinite(measuring.known_score(trial))
    assert set(played) <= met and len(set(played)) == min(len(met), 3)
    assert count is None or met <= {0, 1}


def test_a_training_without_an_episode_is_refused(quick, tmp_path):
    folder = runner.run_trial(Variant("a").config(64, seed=0), tmp_path).folder
    with pytest.raises(ValueError, match=r"no phantom is known where no episode has ended \(64 steps\)"):
        measuring.known_score(Trial.read(folder))
