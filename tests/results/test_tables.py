"""The tables are written and read back without a change; what is none is refused."""

import dataclasses

import pandas as pd
import pytest
from made_records import config, write_trial
from made_tables import made, seeds, trial

from usbench.results import collecting, sources, tables


def test_written_and_read_back_without_a_change(tmp_path):
    for seed in (0, 1):
        write_trial(tmp_path / "runs", config(seed), timings={"training_s": 1 / 3})
    write_trial(tmp_path / "runs", config(2), status="failed", reason='a "quoted", long\r\nreason')
    known = collecting.collect(tmp_path / "runs")
    paths = tables.write(known, tmp_path / "small")
    first = [path.read_bytes() for path in paths]
    again = tables.read(tmp_path / "small")
    pd.testing.assert_frame_equal(again.trials, known.trials)
    pd.testing.assert_frame_equal(again.curves, known.curves)
    tables.write(again, tmp_path / "small")
    assert [path.read_bytes() for path in paths] == first


def test_noise_is_kept_as_it_is(tmp_path):
    """It names a cell, and the command that makes the trial again."""
    for noise in (1e-6, 1 / 3):
        write_trial(tmp_path / "runs", config(noise=noise))
    tables.write(collecting.collect(tmp_path / "runs"), tmp_path / "small")
    assert set(tables.read(tmp_path / "small").trials["noise"]) == {1e-6, 1 / 3}


def test_order_of_folders_on_disk_does_not_matter(tmp_path):
    for folder, order in (("a", (0, 1, 10)), ("b", (10, 1, 0))):
        for seed in order:
            write_trial(tmp_path / folder, config(seed))
        tables.write(collecting.collect(tmp_path / folder), tmp_path / f"small_{folder}")
    for name in (tables.TRIALS, tables.CURVES):
        assert (tmp_path / "small_a" / name).read_bytes() == (tmp_path / "small_b" / name).read_bytes()


def test_nothing_recorded_is_two_empty_tables(tmp_path):
    known = collecting.collect(tmp_path)
    tables.write(known, tmp_path)
    again = tables.read(tmp_path)
    assert again.trials.empty and again.curves.empty
    assert list(again.curves.columns) == list(tables.CURVE_COLUMNS)


def test_texts_that_look_like_numbers_stay_texts(tmp_path):
    known = made(*seeds("vpg", [0.5], configuration="00012345", frames="1e5"), trial("a2c", reason="NA"))
    tables.write(known, tmp_path)
    trials = tables.read(tmp_path).trials
    assert list(trials["configuration"]) == ["00012345", "00000001"]
    assert (trials["frames"].iloc[0], trials["reason"].iloc[1]) == ("1e5", "NA")


def test_missing_tables_are_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"there is no trials\.csv in"):
        tables.read(tmp_path)


@pytest.mark.parametrize("text", ["", "trial,kind\nx,drawn\n", "trial\n\x00"])
def test_broken_table_is_refused(tmp_path, text):
    tables.write(made(trial()), tmp_path)
    (tmp_path / tables.CURVES).write_text(text)
    with pytest.raises(ValueError, match=r"curves\.csv is not a table of results"):
        tables.read(tmp_path)


@pytest.mark.parametrize(
    ("column", "value", "said"),
    [
        ("task", "mine", "a has the task 'mine', which no installed package brings"),
        ("status", "done", "a has the status 'done', not one of running, interrupted"),
        ("settings", "", "a has settings that no trial has, ''"),
        ("settings", "[1]", "a has settings that no trial has, '.1.'"),
        ("settings", '{"senses": 3}', "a has settings that no trial has, '.*3.'"),
        ("settings", '{"n_frames": "x"}', "a has settings that no trial has, '.*x"),
    ],
)
def test_trial_of_a_table_that_cannot_be_is_refused(tmp_path, column, value, said):
    known = made(trial(trial="a"))
    tables.write(dataclasses.replace(known, trials=known.trials.assign(**{column: value})), tmp_path)
    with pytest.raises(ValueError, match=rf"trials\.csv is not a table of results: {said}"):
        tables.read(tmp_path)


def test_trial_that_is_there_twice_is_refused(tmp_path):
    known = made(trial(trial="a"))
    tables.write(dataclasses.replace(known, trials=pd.concat([known.trials] * 2)), tmp_path)
    with pytest.raises(ValueError, match=r"trials\.csv is not a table of results: a is there twice"):
        tables.read(tmp_path)


def test_tables_whose_writing_was_stopped_are_none(tmp_path, monkeypatch):
    """What says that both tables are there, `trials.csv`, is written last."""
    real = tables.atomic_file

    def stopped(path):
        if list(path.parent.iterdir()):
            raise KeyboardInterrupt
        return real(path)

    monkeypatch.setattr(tables, "atomic_file", stopped)
    with pytest.raises(KeyboardInterrupt):
        tables.write(made(trial()), tmp_path)
    assert sources.own_or_published(tmp_path) == sources.published() and sources.bring_published(tmp_path)
    pd.testing.assert_frame_equal(tables.read(tmp_path).trials, tables.read(sources.published()).trials)


def test_finished_trial_without_a_greedy_evaluation_is_refused(tmp_path):
    known = made(trial(trial="a"), trial(trial="b", seed=101), trial(trial="c", seed=102, status="failed"))
    of_b = (known.curves["trial"] == "b") & (known.curves["kind"] == tables.GREEDY)
    tables.write(dataclasses.replace(known, curves=known.curves[~of_b]), tmp_path)
    said = r"curves\.csv does not belong to .*: b is finished, but has no greedy evaluation there\.$"
    with pytest.raises(ValueError, match=said):
        tables.read(tmp_path)


def test_number_that_is_none_is_refused(tmp_path):
    tables.write(made(trial()), tmp_path)
    path = tmp_path / tables.TRIALS
    path.write_text(path.read_text().replace("120.0", "soon"))
    with pytest.raises(ValueError, match=r"trials\.csv is not a table of results"):
        tables.read(tmp_path)
