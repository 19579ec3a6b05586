"""The small record: worked out by hand from records, written and read back without a change."""

import dataclasses
import json

import numpy as np
import pandas as pd
import pytest
from made_tables import made, seeds, trial
from state_files import write_state

from usbench import records
from usbench.records import Episode, Evaluation, TrialConfig
from usbench.records.journal import Journal
from usbench.results import published, tables

ANCHORS = {"optimal": -4.0, "random": -20.0, "stay": -22.0}
STEPS = 100
POSES = {f"{when}_{key}": 0 for when in ("start", "final") for key in ("x_mm", "focal_depth_mm", "angle_deg")}


def config(seed=0, **changes):
    values = {"task": "pp", "algo": "vpg", "noise": 0.25, "seed": seed, "steps": STEPS}
    return TrialConfig(**{**values, "hyperparameters": {"gamma": 0.9}, **changes})


def facts(return_, distance=5.0, sine=0.5, success=False, to_goal=None):
    return {
        "return_": return_,
        "final_distance_mm": distance,
        "final_sin_angle": sine,
        "is_success": success,
        "steps_to_goal": to_goal,
        "poses": POSES,
    }


def write_trial(out, config, status="finished", last=STEPS, **state):
    """Two evaluation episodes of each kind at two checkpoints, and three training episodes."""
    folder = records.create(out, config)
    known = {
        "status": status,
        "reason": None,
        "config": dataclasses.asdict(config),
        "anchors": ANCHORS,
        "timings": {},
        "versions": {},
    } | state
    write_state(folder, known)
    with Journal(folder / records.EPISODES) as journal:
        for number, (step, return_) in enumerate([(1, -20.0), (2, -12.0), (100, -4.0)]):
            journal.append([Episode(episode=number, step=step, **facts(return_)).as_row()])
    with Journal(folder / records.EVALUATIONS) as journal:
        for checkpoint in (0, last):
            for deterministic in (False, True):
                for number, fact in enumerate(
                    [facts(-4.0, 0.0, -1.0, True, 3), facts(-12.0 - 8 * deterministic)]
                ):
                    counters = {"episode": number, "eval_episode": number, "step": checkpoint}
                    mode = {"deterministic": deterministic, "actions": (0,) * 16, "checkpoint": checkpoint}
                    journal.append([Evaluation(**counters, **mode, **fact).as_row()])
    return folder


def test_means_by_hand(tmp_path):
    name = write_trial(tmp_path, config()).name
    curves = tables.collect(tmp_path).curves
    assert list(curves["trial"].unique()) == [name]
    drawn = curves[(curves["kind"] == "drawn") & (curves["step"] == STEPS)].iloc[0]
    assert drawn["episodes"] == 2
    assert drawn["return"] == -8.0
    assert drawn["normalized_score"] == 0.75
    assert drawn["final_distance_mm"] == 2.5
    # Sines -1 and 0.5: 90 and 30 degrees whatever their sign.
    assert drawn["abs_sin_angle"] == 0.75
    assert drawn["plane_error_deg"] == 60.0
    assert (drawn["success_rate"], drawn["reached_rate"]) == (0.5, 0.5)
    # 3 steps, and 16 for the episode that never got there.
    assert drawn["steps_to_goal"] == 9.5
    greedy = curves[(curves["kind"] == "greedy") & (curves["step"] == STEPS)].iloc[0]
    assert greedy["return"] == -12.0


def test_training_is_kept_in_fiftieths_of_the_budget(tmp_path):
    write_trial(tmp_path, config())
    curves = tables.collect(tmp_path).curves
    training = curves[curves["kind"] == "training"]
    # Episodes that end at steps 1 and 2 belong to the first two hundredths, the last one to the end.
    assert list(training["step"]) == [2, 100]
    assert list(training["episodes"]) == [2, 1]
    assert list(training["return"]) == [-16.0, -4.0]
    # Never reached: the 16 steps that there are, however soon an agent ends its episode.
    assert list(training["steps_to_goal"]) == [16.0, 16.0]


def test_trial_row_tells_status_settings_versions_and_time(tmp_path):
    write_trial(
        tmp_path,
        config(),
        timings={"training_s": 7.5, "total_s": 9.0},
        versions={"torch": "2.5", "numpy": "2.0"},
        frames={"digest": "0123456789abcdef" * 4},
    )
    row = tables.collect(tmp_path).trials.iloc[0]
    assert (row["task"], row["noise"], row["algo"], row["seed"], row["steps"]) == ("pp", 0.25, "vpg", 0, 100)
    assert (row["status"], row["training_s"], row["total_s"]) == ("finished", 7.5, 9.0)
    assert row["versions"] == "numpy 2.0, torch 2.5"
    assert row["frames"] == "0123456789abcdef"
    assert json.loads(row["settings"])["gamma"] == 0.9


def test_what_an_agent_is_told_is_no_part_of_its_environment(tmp_path):
    plain = {"id": "usbench/ProbePlane-v0"}
    for seed, told in enumerate(({}, {"senses": ["position", "heading"]})):
        write_trial(tmp_path, config(seed, environment=plain | told))
    first, second = tables.collect(tmp_path).trials.sort_values("seed")["settings"]
    assert tables.senses(first) == () and "senses" not in json.loads(first)
    assert tables.senses(second) == ("position", "heading")
    assert json.loads(first)["environment"] == json.loads(second)["environment"]


def test_hyperparameters_hide_no_setting(tmp_path):
    own = {"n_frames": 4, "n_envs": 1, "senses": "position", "environment": "pp"}
    write_trial(tmp_path, config(n_frames=16, n_envs=2, hyperparameters=own))
    settings = tables.collect(tmp_path).trials["settings"].iloc[0]
    assert (tables.n_frames(settings), tables.senses(settings)) == (16, ())
    assert json.loads(settings)["n_envs"] == 2 and json.loads(settings)["environment"] != "pp"


@pytest.mark.parametrize("steps", [[0, 0], [50, 0]])
def test_evaluations_that_are_out_of_order_are_damaged(tmp_path, steps):
    folder = write_trial(tmp_path, config())
    path = folder / records.EVALUATIONS
    rows = [json.loads(line) for line in path.read_text().splitlines()]
    for row in rows:
        row["step"] = steps[row["checkpoint"] > 0]
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
    with pytest.raises(ValueError, match="is damaged: the training steps of its evaluations do not grow"):
        tables.collect(tmp_path)


def test_configuration_is_the_same_for_every_seed_and_differs_otherwise(tmp_path):
    for each in (config(0), config(1), config(0, hyperparameters={"gamma": 0.8})):
        write_trial(tmp_path, each)
    trials = tables.collect(tmp_path).trials
    assert trials.groupby("configuration")["seed"].apply(sorted).tolist() in ([[0, 1], [0]], [[0], [0, 1]])


def test_unfinished_trials_are_rows_without_curves(tmp_path):
    write_trial(tmp_path, config(0))
    write_trial(tmp_path, config(1), status="failed", reason="OSError: disk full")
    known = tables.collect(tmp_path)
    assert list(known.trials["status"]) == ["finished", "failed"]
    assert list(known.trials["reason"]) == ["", "OSError: disk full"]
    assert known.curves["trial"].nunique() == 1


def test_only_planned_trials_count_and_missing_ones_are_named(tmp_path):
    write_trial(tmp_path, config(0))
    write_trial(tmp_path, config(7))
    known = tables.collect(tmp_path, [config(0), config(1)])
    assert list(known.trials["seed"]) == [0, 1]
    assert list(known.trials["status"]) == ["finished", "missing"]
    assert known.trials["configuration"].nunique() == 1
    assert np.isnan(known.trials["optimal"].iloc[1])


def test_trial_killed_in_its_first_moment_is_missing(tmp_path):
    records.create(tmp_path, config(0))
    assert tables.collect(tmp_path).trials.empty
    assert list(tables.collect(tmp_path, [config(0)]).trials["status"]) == ["missing"]


def test_written_and_read_back_without_a_change(tmp_path):
    for seed in (0, 1):
        write_trial(tmp_path / "runs", config(seed), timings={"training_s": 1 / 3})
    write_trial(tmp_path / "runs", config(2), status="failed", reason='a "quoted", long\r\nreason')
    known = tables.collect(tmp_path / "runs")
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
    tables.write(tables.collect(tmp_path / "runs"), tmp_path / "small")
    assert set(tables.read(tmp_path / "small").trials["noise"]) == {1e-6, 1 / 3}


def test_order_of_folders_on_disk_does_not_matter(tmp_path):
    for folder, order in (("a", (0, 1, 10)), ("b", (10, 1, 0))):
        for seed in order:
            write_trial(tmp_path / folder, config(seed))
        tables.write(tables.collect(tmp_path / folder), tmp_path / f"small_{folder}")
    for name in (tables.TRIALS, tables.CURVES):
        assert (tmp_path / "small_a" / name).read_bytes() == (tmp_path / "small_b" / name).read_bytes()


def test_nothing_recorded_is_two_empty_tables(tmp_path):
    known = tables.collect(tmp_path)
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


def test_missing_last_evaluation_is_refused(tmp_path):
    name = write_trial(tmp_path, config(), last=50).name
    with pytest.raises(ValueError, match=f"{name} is finished, but its evaluation at step 100 is missing"):
        tables.collect(tmp_path)


def test_trial_on_a_task_that_is_not_installed_is_refused(tmp_path):
    folder = write_trial(tmp_path, config(task="elsewhere"))
    with pytest.raises(ValueError, match=f"{folder.name}' cannot be shown: unknown task 'elsewhere'"):
        tables.collect(tmp_path)


@pytest.mark.parametrize("status", ["finished", "running"])
def test_trial_on_a_task_that_is_not_installed_does_not_hide_the_others(tmp_path, status):
    name = write_trial(tmp_path, config(task="elsewhere"), status=status).name
    known, told = write_trial(tmp_path, config()).name, []
    assert list(tables.collect(tmp_path, damaged=told.append).trials["trial"]) == [known]
    assert len(told) == 1 and name in told[0]


def test_same_trial_in_two_folders_is_refused(tmp_path):
    folder = write_trial(tmp_path, config())
    (tmp_path / "copy").mkdir()
    (tmp_path / "copy" / records.TRIAL).write_bytes((folder / records.TRIAL).read_bytes())
    with pytest.raises(ValueError, match="are the same trial"):
        tables.collect(tmp_path)


def test_missing_folders_are_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match="there is no folder"):
        tables.collect(tmp_path / "nothing")
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
    assert published.or_own(tmp_path) == published.folder() and published.bring(tmp_path)
    pd.testing.assert_frame_equal(tables.read(tmp_path).trials, tables.read(published.folder()).trials)


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
