"""Records become tables: what stands in them is worked out by hand."""

import json

import numpy as np
import pytest
from made_records import STEPS, config, write_trial

from usbench import records
from usbench.results import collecting, tables


def test_means_by_hand(tmp_path):
    name = write_trial(tmp_path, config()).name
    curves = collecting.collect(tmp_path).curves
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
    curves = collecting.collect(tmp_path).curves
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
    row = collecting.collect(tmp_path).trials.iloc[0]
    assert (row["task"], row["noise"], row["algo"], row["seed"], row["steps"]) == ("pp", 0.25, "vpg", 0, 100)
    assert (row["status"], row["training_s"], row["total_s"]) == ("finished", 7.5, 9.0)
    assert row["versions"] == "numpy 2.0, torch 2.5"
    assert row["frames"] == "0123456789abcdef"
    assert json.loads(row["settings"])["gamma"] == 0.9


def test_what_an_agent_is_told_is_no_part_of_its_environment(tmp_path):
    plain = {"id": "usbench/ProbePlane-v0"}
    for seed, told in enumerate(({}, {"senses": ["position", "heading"]})):
        write_trial(tmp_path, config(seed, environment=plain | told))
    first, second = collecting.collect(tmp_path).trials.sort_values("seed")["settings"]
    assert tables.senses(first) == () and "senses" not in json.loads(first)
    assert tables.senses(second) == ("position", "heading")
    assert json.loads(first)["environment"] == json.loads(second)["environment"]


@pytest.mark.parametrize("senses", [[1], "position", 3])
def test_trial_with_senses_that_cannot_be_some_does_not_hide_the_others(tmp_path, senses):
    write_trial(tmp_path, config(environment={"id": "usbench/ProbePlane-v0", "senses": senses}))
    good = write_trial(tmp_path, config(1)).name
    found, told = collecting.collect(tmp_path, damaged=(said := []).append), said
    assert list(found.trials["trial"]) == [good]
    assert len(told) == 1 and "senses must be names" in told[0]


def test_hyperparameters_hide_no_setting(tmp_path):
    own = {"n_frames": 4, "n_envs": 1, "senses": "position", "environment": "pp"}
    write_trial(tmp_path, config(n_frames=16, n_envs=2, hyperparameters=own))
    settings = collecting.collect(tmp_path).trials["settings"].iloc[0]
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
        collecting.collect(tmp_path)


def test_configuration_is_the_same_for_every_seed_and_differs_otherwise(tmp_path):
    for each in (config(0), config(1), config(0, hyperparameters={"gamma": 0.8})):
        write_trial(tmp_path, each)
    trials = collecting.collect(tmp_path).trials
    assert trials.groupby("configuration")["seed"].apply(sorted).tolist() in ([[0, 1], [0]], [[0], [0, 1]])


def test_unfinished_trials_are_rows_without_curves(tmp_path):
    write_trial(tmp_path, config(0))
    write_trial(tmp_path, config(1), status="failed", reason="OSError: disk full")
    known = collecting.collect(tmp_path)
    assert list(known.trials["status"]) == ["finished", "failed"]
    assert list(known.trials["reason"]) == ["", "OSError: disk full"]
    assert known.curves["trial"].nunique() == 1


def test_only_planned_trials_count_and_missing_ones_are_named(tmp_path):
    write_trial(tmp_path, config(0))
    write_trial(tmp_path, config(7))
    known = collecting.collect(tmp_path, [config(0), config(1)])
    assert list(known.trials["seed"]) == [0, 1]
    assert list(known.trials["status"]) == ["finished", "missing"]
    assert known.trials["configuration"].nunique() == 1
    assert np.isnan(known.trials["optimal"].iloc[1])


def test_trial_killed_in_its_first_moment_is_missing(tmp_path):
    records.create(tmp_path, config(0))
    assert collecting.collect(tmp_path).trials.empty
    assert list(collecting.collect(tmp_path, [config(0)]).trials["status"]) == ["missing"]


def test_missing_last_evaluation_is_refused(tmp_path):
    name = write_trial(tmp_path, config(), last=50).name
    with pytest.raises(ValueError, match=f"{name} is finished, but its evaluation at step 100 is missing"):
        collecting.collect(tmp_path)


def test_trial_on_a_task_that_is_not_installed_is_refused(tmp_path):
    folder = write_trial(tmp_path, config(task="elsewhere"))
    with pytest.raises(ValueError, match=f"{folder.name}' cannot be shown: unknown task 'elsewhere'"):
        collecting.collect(tmp_path)


@pytest.mark.parametrize("status", ["finished", "running"])
def test_trial_on_a_task_that_is_not_installed_does_not_hide_the_others(tmp_path, status):
    name = write_trial(tmp_path, config(task="elsewhere"), status=status).name
    known, told = write_trial(tmp_path, config()).name, []
    assert list(collecting.collect(tmp_path, damaged=told.append).trials["trial"]) == [known]
    assert len(told) == 1 and name in told[0]


def test_same_trial_in_two_folders_is_refused(tmp_path):
    folder = write_trial(tmp_path, config())
    (tmp_path / "copy").mkdir()
    (tmp_path / "copy" / records.TRIAL).write_bytes((folder / records.TRIAL).read_bytes())
    with pytest.raises(ValueError, match="are the same trial"):
        collecting.collect(tmp_path)


def test_missing_folder_is_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match="there is no folder"):
        collecting.collect(tmp_path / "nothing")
