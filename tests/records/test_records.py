"""Records: written whole, read back, and refused in one sentence where they are broken."""

import json
import math
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from state_files import write_state

from usbench import records
from usbench.anchors import Anchors
from usbench.records import ConfigurationError, Evaluation, Trial, TrialConfig, checksums
from usbench.records.journal import Journal, read_rows

CONFIG = TrialConfig(task="pp", algo="vpg", noise=0.25, seed=3, steps=64, hyperparameters={"gamma": 0.9})
ANCHORS = {"optimal": -4.0, "random": -20.0, "stay": -22.0}


def evaluation(number=0, return_=-12.0, sine=0.5, **changes):
    values = {
        "episode": number,
        "eval_episode": number,
        "step": 64,
        "checkpoint": 64,
        "deterministic": False,
        "actions": (0, 1),
        "return_": return_,
        "poses": {
            "start_x_mm": -5,
            "start_focal_depth_mm": 50,
            "start_angle_deg": 45,
            "final_x_mm": 0,
            "final_focal_depth_mm": 50,
            "final_angle_deg": 30,
        },
        "final_distance_mm": 0.0,
        "final_sin_angle": sine,
        "is_success": False,
        "steps_to_goal": None,
    }
    return Evaluation(**{**values, **changes})


def state(status="finished"):
    return {
        "status": status,
        "reason": None,
        "config": asdict(CONFIG),
        "anchors": ANCHORS,
        "timings": {"total_s": 1.5},
        "versions": {"numpy": "2.0"},
    }


def trial(out, config=CONFIG, status="finished", rows=2):
    folder = records.create(out, config)
    write_state(folder, state(status))
    with Journal(folder / records.EVALUATIONS) as journal:
        journal.append(evaluation(number).as_row() for number in range(rows))
    return folder


def test_folder_name_says_the_trial_and_hashes_the_rest():
    assert CONFIG.folder_name == f"pp-p0.25-vpg-s3-{CONFIG.hash}"
    assert len(CONFIG.hash) == 8 and int(CONFIG.hash, 16) >= 0
    other = TrialConfig(task="pp", algo="vpg", noise=0.25, seed=3, steps=64, hyperparameters={"gamma": 0.8})
    assert other.hash != CONFIG.hash


def test_hash_does_not_depend_on_the_order_of_settings():
    one, two = ({"a": 1, "b": 2.5}, {"b": 2.5, "a": 1})
    hashes = {
        TrialConfig(task="fp", algo="vpg", noise=0, seed=0, steps=1, hyperparameters=settings).hash
        for settings in (one, two)
    }
    assert len(hashes) == 1


def test_rows_have_the_keys_of_the_specification(tmp_path):
    (row, _) = read_rows(trial(tmp_path) / records.EVALUATIONS)
    assert {
        "episode", "step", "return", "start_x_mm", "start_focal_depth_mm", "start_angle_deg",
        "final_x_mm", "final_focal_depth_mm", "final_angle_deg", "is_success", "checkpoint", "deterministic",
    } <= set(row)  # fmt: skip
    assert row["actions"] == [0, 1] and row["steps_to_goal"] is None


def test_load_gives_one_table_with_the_normalised_score(tmp_path):
    trial(tmp_path)
    table = records.load(tmp_path)
    assert list(table.columns[:6]) == ["trial", "task", "noise", "algo", "seed", "status"]
    assert len(table) == 2
    # (-12 + 20) / (-4 + 20)
    np.testing.assert_allclose(table["normalized_score"], 0.5)


def test_load_takes_one_trial_and_passes_over_earlier_attempts(tmp_path):
    first = trial(tmp_path, status="interrupted")
    with Journal(first / records.EPISODES) as journal:
        journal.append([evaluation().as_row()])
    folder = trial(tmp_path, rows=1)
    assert (tmp_path / f"{folder.name}.earlier-1" / records.EVALUATIONS).exists()
    assert len(records.load(tmp_path)) == 1
    assert len(records.load(folder)) == 1


def test_a_trial_that_is_the_present_folder_has_its_name(tmp_path, monkeypatch):
    folder = trial(tmp_path)
    monkeypatch.chdir(folder)
    assert [one.name for one in records.load_trials(".")] == [folder.name]
    monkeypatch.chdir(tmp_path)
    assert records.trial_folders(Path(folder.name)) == [Path(folder.name)]


def test_load_of_an_empty_folder_is_an_empty_table(tmp_path):
    columns = list(records.load(trial(tmp_path / "full")).columns)
    for table in ("evaluations", "episodes"):
        empty = records.load(tmp_path, table)
        assert empty.empty and set(empty.columns) <= set(columns)
        assert list(empty.columns[:6]) == columns[:6] and empty.columns[-1] == columns[-1]
        assert empty.groupby("algo")["normalized_score"].mean().empty


def test_load_refuses_a_missing_folder(tmp_path):
    with pytest.raises(FileNotFoundError, match="nowhere"):
        records.load(tmp_path / "nowhere")


def test_load_refuses_an_unknown_table(tmp_path):
    with pytest.raises(ValueError, match="evaluations, episodes"):
        records.load(tmp_path, "scores")


@pytest.mark.parametrize("text", ["", "{", "[]", '{"schema": 99}', "[" * 100_000, '{"a":' * 100_000])
def test_broken_trial_file_is_refused(tmp_path, text):
    (tmp_path / records.TRIAL).write_text(text)
    with pytest.raises(ValueError, match=r"trial\.json"):
        Trial.read(tmp_path)


def test_trial_file_that_does_not_fit_into_the_memory_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(type(tmp_path), "read_bytes", lambda _: bytes(1 << 62))
    with pytest.raises(
        ValueError, match=r"trial\.json is not a trial record: it does not fit into the memory"
    ):
        Trial.read(tmp_path)


@pytest.mark.parametrize(
    "changes",
    [
        {"versions": {"<img src=x>": "1"}},
        {"versions": {"numpy": "2\r"}},
        {"config": asdict(CONFIG) | {"algo": r"mine:$\frac$"}},
    ],
)
def test_a_record_with_markup_in_a_name_is_refused(tmp_path, changes):
    write_state(tmp_path, {"status": "running", "config": asdict(CONFIG), "anchors": ANCHORS} | changes)
    with pytest.raises(ValueError, match=r"is not a trial record: its .* cannot be"):
        Trial.read(tmp_path)


def test_a_line_with_a_key_that_a_table_has_itself_does_not_stop_the_table(tmp_path):
    write_state(tmp_path, {"status": "running", "config": asdict(CONFIG), "anchors": ANCHORS})
    with Journal(tmp_path / records.EVALUATIONS) as journal:
        journal.append([evaluation().as_row() | {"task": "fp"}])
    assert list(records.load(tmp_path)["task"]) == ["pp"]


def test_unknown_status_is_refused(tmp_path):
    with pytest.raises(ValueError, match="'running', 'interrupted', 'failed' or 'finished'"):
        write_state(tmp_path, state("done"))
        Trial.read(tmp_path)


def test_output_folder_that_is_a_file_is_refused(tmp_path):
    (tmp_path / "runs").write_text("")
    with pytest.raises(ConfigurationError, match="runs' cannot be written"):
        records.create(tmp_path / "runs", CONFIG)


def test_folder_of_a_trial_without_an_episode_is_used_again(tmp_path):
    folder = trial(tmp_path, status="running")
    (folder / records.EPISODES).touch()
    (folder / records.CHECKPOINTS).mkdir()
    assert records.create(tmp_path, CONFIG) == folder
    assert [path.name for path in tmp_path.glob("*/*")] == [records.TRIAL]
    assert not list(tmp_path.glob("*.earlier-*"))


def test_what_an_agent_that_learns_nothing_left_is_not_kept_beside(tmp_path):
    folder = trial(tmp_path, rows=1)
    for name in (records.REPLAY, records.LEARNING_CURVE):
        (folder / name).touch()
    assert records.create(tmp_path, CONFIG) == folder
    assert [path.name for path in tmp_path.glob("*/*")] == [records.TRIAL]


def test_somebody_elses_file_in_a_trial_folder_is_never_removed(tmp_path):
    (trial(tmp_path, status="running") / "notes.txt").write_text("mine")
    folder = records.create(tmp_path, CONFIG)
    assert (tmp_path / f"{folder.name}.earlier-1" / "notes.txt").read_text() == "mine"


def test_records_that_are_not_what_was_written_are_refused(tmp_path):
    folder = trial(tmp_path)
    write_state(folder, state() | {"checksums": checksums.of(folder, [records.EVALUATIONS])})
    assert len(records.load(tmp_path)) == 2
    with (folder / records.EVALUATIONS).open("ab") as file:
        file.write(b"{}\n")
    with pytest.raises(ValueError, match="evaluations.jsonl is damaged"):
        records.load(tmp_path)


@pytest.mark.parametrize(
    "changed",
    [
        {"return": None},
        {"return": "high"},
        {"checkpoint": "last"},
        {"final_distance_mm": "far"},
        {"final_sin_angle": None},
        {"is_success": "yes"},
        {},
    ],
)
def test_a_line_without_a_number_that_is_needed_is_refused(tmp_path, changed):
    folder = trial(tmp_path)
    with Journal(folder / records.EVALUATIONS) as journal:
        journal.append([{**evaluation(2).as_row(), **changed} if changed else {}])
    with pytest.raises(ValueError, match=r"evaluations.jsonl is damaged: a line of it has no number '"):
        Trial.read(folder).evaluations()


def test_infinity_of_another_program_is_refused(tmp_path):
    folder = trial(tmp_path)
    with (folder / records.EVALUATIONS).open("a") as file:
        file.write(json.dumps({**evaluation(2).as_row(), "return": math.inf}) + "\n")
    with pytest.raises(ValueError, match="evaluations.jsonl is damaged: a line of it has no number 'return'"):
        Trial.read(folder).evaluations()


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"final_sin_angle": -1.5}, r"a line of it has no 'final_sin_angle' in \[-1, 1\]\."),
        ({"steps_to_goal": "never"}, "a 'steps_to_goal' that is neither a number nor null"),
    ],
)
def test_a_number_that_cannot_be_is_refused(tmp_path, changed, said):
    folder = trial(tmp_path)
    with Journal(folder / records.EVALUATIONS) as journal:
        journal.append([{**evaluation(2).as_row(), **changed}])
    with pytest.raises(ValueError, match=f"evaluations.jsonl is damaged: .*{said}"):
        Trial.read(folder).evaluations()


def test_lines_that_do_not_say_when_the_goal_was_reached_are_refused(tmp_path):
    folder = trial(tmp_path, rows=0)
    row = evaluation().as_row()
    del row["steps_to_goal"]
    with Journal(folder / records.EVALUATIONS) as journal:
        journal.append([row])
    with pytest.raises(ValueError, match=r"evaluations.jsonl is damaged: no line of it has 'steps_to_goal'"):
        Trial.read(folder).evaluations()


def test_a_last_evaluation_without_such_actions_is_refused(tmp_path):
    last = Trial.read(trial(tmp_path))
    assert len(last.last_evaluation(deterministic=False)) == 2
    with pytest.raises(ValueError, match="has no evaluations"):
        Trial.read(trial(tmp_path / "none", rows=0)).last_evaluation(deterministic=True)
    with pytest.raises(ValueError, match="has no episodes with greedy actions"):
        last.last_evaluation(deterministic=True)


def test_means_count_the_plane_error_modulo_half_a_turn():
    rows = pd.DataFrame([evaluation(sine=sine).as_row() for sine in (0.5, -0.5, 1.0, 0.0)])
    means = records.means(rows)
    assert means["plane_error_deg"] == pytest.approx((30 + 30 + 90 + 0) / 4)
    assert means["return"] == -12.0


def test_a_trial_is_read_back_as_it_was_written(tmp_path):
    frames = records.Frames("0" * 64, 216)
    written = Trial(
        folder=tmp_path, status="finished", config=CONFIG, anchors=Anchors(**ANCHORS), frames=frames,
        evaluation_points=(0, 64), n_evaluation_episodes=56, timings={"total_s": 1.5},
        references={"random": {"return": -20.0}}, versions={"numpy": "2.0"},
    )  # fmt: skip
    written.write()
    assert Trial.read(tmp_path) == written
    assert Trial.find(tmp_path / "nothing") is None


def test_reading_what_is_no_trial_says_so(tmp_path):
    with pytest.raises(ConfigurationError, match="not the folder of a trial: no trial.json in it"):
        Trial.read(tmp_path)
    with pytest.raises(ConfigurationError, match="not the folder of a trial: it does not exist"):
        Trial.read(tmp_path / "nothing")


@pytest.mark.parametrize(
    ("part", "value", "message"),
    [
        ("config", {"task": "pp"}, "it has no config.algo"),
        ("config", {**asdict(CONFIG), "noise": 1.5}, "its config.noise cannot be 1.5"),
        ("config", {**asdict(CONFIG), "seed": True}, "its config.seed cannot be True"),
        ("anchors", {"optimal": "x", "random": 1, "stay": 2}, "its anchors.optimal cannot be 'x'"),
        ("timings", {"total_s": "long"}, "its timings.total_s cannot be 'long'"),
        ("checksums", {"../model.zip": "0"}, "cannot be '../model.zip'"),
        ("checkpoints", [0, -1], "its checkpoints.1 cannot be -1"),
        ("frames", {}, "it has no frames.digest"),
    ],
)
def test_a_record_that_cannot_be_is_refused_in_one_sentence(tmp_path, part, value, message):
    write_state(tmp_path, state() | {part: value})
    with pytest.raises(ValueError, match=message) as refusal:
        Trial.read(tmp_path)
    assert "\n" not in str(refusal.value)
