"""Trials in an anatomy of one's own: from the command line into the records, and found again."""

import base64
import json
import shutil
import sys
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from usbench import cli, guide, own_anatomy, records, replay, results, runner, suite
from usbench.envs import anatomy, frames, guidance, oracle
from usbench.envs.anatomy import Echogenicity, Recording
from usbench.envs.bmode import DEFAULT_IMAGING
from usbench.envs.placement import Placement
from usbench.envs.pose import Pose
from usbench.envs.probe import DEFAULT_ARRAY
from usbench.guide_agents import ORACLE
from usbench.guide_session import Session
from usbench.models import load_agent
from usbench.records import ConfigurationError

FOLDER = Path(__file__).parent
sys.path[:0] = [str(FOLDER), str(FOLDER / "envs")]
import sweep_worker  # noqa: E402
from volumes import block, write  # noqa: E402

TARGET = ["target_x_mm=10", "target_angle_deg=30"]
RUN = ["run", "--algo", "vpg", "--task", "pp", "--steps", "64", "--quiet", "--phantom"]


@pytest.fixture(scope="module")
def _made(tmp_path_factory):
    """A volume, a trial in it made by the command line, and the frames that it kept."""
    folder = tmp_path_factory.mktemp("anatomy")
    block(folder / "block.mha")
    with pytest.MonkeyPatch.context() as monkeypatch:
        _true_frames(monkeypatch, folder)
        argv = [*RUN, str(folder / "block.mha"), "frames=recorded", *TARGET, "--out", str(folder / "runs")]
        assert cli.main(argv) == 0
    return folder


def _true_frames(monkeypatch, folder):
    """Quick trials, but with slices of the volume, kept in `folder`."""
    sweep_worker.speed_up(monkeypatch)
    monkeypatch.setenv("USBENCH_CACHE", str(folder / "cache"))
    for module in ("envs.guidance", "runner", "board", "guide"):
        monkeypatch.setattr(f"usbench.{module}.frame_store", frames.frame_store)
    frames.frame_store.cache_clear()


@pytest.fixture
def made(_made, tmp_path, monkeypatch):
    """All of it, a copy for this test alone."""
    shutil.copytree(_made, tmp_path, dirs_exist_ok=True)
    _true_frames(monkeypatch, tmp_path)
    yield tmp_path
    frames.frame_store.cache_clear()


@pytest.fixture
def trial(made):
    """The trial's folder."""
    (folder,) = records.trial_folders(made / "runs")
    return folder


@pytest.fixture
def file(_made, tmp_path):
    """The volume, at a place of this test alone."""
    return Path(shutil.copy(_made / "block.mha", tmp_path))


def asked(file, *settings):
    return own_anatomy.asked([str(file), *TARGET, *settings])


def resolved(file, *settings):
    return runner.resolve("vpg", "pp", steps=64, anatomy=asked(file, *settings))


def frames_of(own, pose):
    return own.frames([pose], DEFAULT_ARRAY, DEFAULT_IMAGING)[0]


def refusal(capsys, *argv):
    assert cli.main(list(argv)) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith("usbench: error: ") and captured.err.count("\n") == 1
    return captured.err


def test_words_become_an_anatomy(file):
    found = asked(
        file, "frames=recorded", "down=-y", "lateral=k", "center_x_mm=1.5", "center_y_mm=-2", "skin_mm=0"
    )
    assert found == Recording(
        path=str(file),
        digest=anatomy.read(file).digest,
        target=Pose(10, 50, 30),
        placement=Placement("k", "-y", 1.5, -2.0, 0.0),
    )
    simulated = asked(
        file, "seed=3", "density_per_mm3=0.5", "dynamic_range_db=60", "target_focal_depth_mm=40"
    )
    assert isinstance(simulated, Echogenicity) and simulated.target == Pose(10, 40, 30)
    assert (simulated.seed, simulated.density_per_mm3, simulated.dynamic_range_db) == (3, 0.5, 60.0)
    assert own_anatomy.asked([]) is None


@pytest.mark.parametrize("frames", ["simulated", "recorded"])
def test_what_is_recorded_is_the_same_again(file, frames):
    found = asked(file, f"frames={frames}", "skin_mm=3")
    plain = json.loads(json.dumps(own_anatomy.plain(found)))
    again = own_anatomy.recorded(plain)
    assert again == found and again.path == found.path and type(again) is type(found)
    assert own_anatomy.recorded({"id": "usbench/ProbePlane-v0", "phantom": {"seed": 0}}) is None


@pytest.mark.parametrize(
    "damage",
    [
        {"phantom": None},
        {"phantom": {}},
        {"phantom": {"frames": "dreamt"}},
        {"phantom": {"target": {"x_mm": "far"}}},
        {"phantom": {"placement": {"down": "up"}}},
        {"phantom": {"target": 3}},
        {"phantom": {"seed": 1}},
    ],
)
def test_records_of_strangers_are_refused(file, damage):
    plain = own_anatomy.plain(asked(file, "frames=recorded"))
    phantom = damage["phantom"] and {**plain["phantom"], **damage["phantom"]}
    if damage["phantom"] == {}:
        phantom = {}
    with pytest.raises(ConfigurationError, match="the trial's phantom"):
        own_anatomy.recorded({**plain, "phantom": phantom})


def test_a_trial_tells_where_the_volume_was_and_what_was_looked_for(trial, _made):
    state = records.read_state(trial)
    environment = state["config"]["environment"]
    assert environment["volume"] == str(_made / "block.mha")
    assert environment["phantom"]["digest"] == anatomy.read(_made / "block.mha").digest
    assert state["anchors"] == asdict(oracle.returns("pp", target=Pose(10, 50, 30)))
    evaluations = records.load(trial)
    assert set(evaluations["target_x_mm"]) == {10} and set(evaluations["target_angle_deg"]) == {30}
    assert "phantom" not in evaluations
    # The exact plan knows the target.
    assert state["references"]["optimal"]["success_rate"] == 1


def test_the_same_content_is_the_same_trial_wherever_it_lies(trial, file, tmp_path):
    moved = file.rename(tmp_path / "moved.mha")
    config = resolved(moved, "frames=recorded")
    assert config.folder_name == trial.name
    assert runner.run_trial(config, trial.parent).skipped
    again = runner.run_trial(config, tmp_path / "again").folder
    for name in (records.EPISODES, records.EVALUATIONS):
        assert (again / name).read_bytes() == (trial / name).read_bytes()
    # Folders with both tell of one configuration, not of two.
    tables = [results.collect(folder.parent).trials for folder in (trial, again)]
    assert tables[0]["configuration"].tolist() == tables[1]["configuration"].tolist()
    others = [
        runner.resolve("vpg", "pp", steps=64),
        resolved(moved),
        resolved(moved, "frames=recorded", "skin_mm=1"),
        resolved(moved, "frames=recorded", "target_x_mm=5"),
    ]
    assert len({config.hash, *(other.hash for other in others)}) == 5


def test_the_papers_trials_are_called_as_ever():
    # The name that docs and earlier trials have.
    assert runner.resolve("dqn", "pp", steps=2048).folder_name == "pp-p0-dqn-s0-b8247cf7"


def test_watching_finds_the_volume_again_or_says_what_is_missing(trial, _made, capsys, made, monkeypatch):
    assert cli.main(["watch", str(trial), "--episode", "0"]) == 0
    out = capsys.readouterr().out
    assert "optimum" in out and len(out.splitlines()) == 19
    # What is kept needs no file; without both there is a sentence.
    own = own_anatomy.recorded(records.read_state(trial)["config"]["environment"])
    gone = replace(own, path=str(made / "gone.mha"))
    monkeypatch.setattr(own_anatomy, "recorded", lambda _: gone)
    anatomy._volume.cache_clear()
    assert cli.main(["watch", str(trial), "--episode", "0"]) == 0
    shutil.rmtree(made / "cache")
    frames.frame_store.cache_clear()
    capsys.readouterr()
    assert cli.main(["watch", str(trial), "--episode", "0"]) == 1
    assert f"there is no volume '{gone.path}'" in capsys.readouterr().err
    write(made / "gone.mha", np.full((91, 61, 81), 100, np.uint8))
    assert cli.main(["watch", str(trial), "--episode", "0"]) == 1
    assert "has been changed: its digest must be" in capsys.readouterr().err


def test_a_replay_is_of_the_volume(trial):
    own = own_anatomy.recorded(records.read_state(trial)["config"]["environment"])
    record = replay.typical_episode(trial)
    *_, last = replay.play("pp", 0.0, int(record["eval_episode"]), record["actions"], anatomy=own)
    assert last.return_ == record["return"]
    # The optimum is that of the target.
    planned = suite.evaluation_episodes("pp")[int(record["eval_episode"])]
    assert last.optimum == pytest.approx(oracle.policy("pp", target=own.target).value(0, planned.start))


def test_a_saved_agent_is_opened_for_the_volume(trial, file):
    loaded = load_agent(trial)
    assert loaded.config.folder_name == trial.name
    assert own_anatomy.recorded(loaded.config.environment) == asked(file, "frames=recorded")


def test_the_guide_is_in_the_volume_of_the_trial(trial, tmp_path):
    session = Session(tmp_path / "nothing", trial, seed=0)
    own = session.anatomy
    assert own.target == Pose(10, 50, 30) and session.tasks == ("pp",)
    state = session.state()
    assert list(state["tasks"]) == ["pp"] and not state["training"]["offered"]
    assert state["balls"] == [] and state["target"] == {"x_mm": 10, "focal_depth_mm": 50, "angle_deg": 30}
    shown = np.frombuffer(base64.b64decode(state["frame"]), np.uint8).reshape(90, 40)
    np.testing.assert_array_equal(shown, frames_of(own, session.examination.pose))
    with pytest.raises(ConfigurationError, match="allowed are 'pp'"):
        session.choose(task="fp")
    # The optimum leads to the target.
    session.choose(agent=ORACLE)
    for _ in range(16):
        session.follow()
    assert session.state()["verdict"].startswith("Success")
    session.choose(hidden=True)
    assert session.state()["target"] is None


def test_agents_of_another_anatomy_do_not_advise(trial, monkeypatch):
    # Frames are not looked at here: drawn ones will do.
    sweep_worker.speed_up(monkeypatch)
    monkeypatch.setattr(guide, "frame_store", guidance.frame_store)
    assert Session(trial.parent, seed=0).agent == ORACLE
    other = runner.run_trial(runner.resolve("vpg", "pp", steps=16), trial.parent).folder
    assert Session(trial.parent, seed=0).agent == other.name
    agents = [agent["name"] for agent in Session(trial.parent, trial, seed=0).state()["agents"]]
    assert agents == [trial.name, ORACLE]


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ([], "target_x_mm"),
        (["frames=filmed", *TARGET], "'recorded'"),
        (["down=up", *TARGET], "'up'"),
        (["dwon=y", *TARGET], "did you mean 'down'"),
        (["frames=recorded", "seed=1", *TARGET], "unknown setting of a phantom 'seed'"),
        (["skin_mm", *TARGET], "name=value"),
        (["skin_mm=deep", *TARGET], "'deep'"),
        (
            ["target_x_mm=7", "target_angle_deg=0"],
            "the nearest, Pose(x_mm=5, focal_depth_mm=50, angle_deg=0)",
        ),
        (
            ["target_x_mm=0", "target_angle_deg=10"],
            "the nearest, Pose(x_mm=0, focal_depth_mm=50, angle_deg=15)",
        ),
        (["target_x_mm=60"], "[-40, 40]"),
        (["target_x_mm=far"], "'far'"),
    ],
)
def test_settings_that_cannot_be_are_refused_in_one_sentence(capsys, file, settings, said):
    assert said in refusal(capsys, *RUN, str(file), *settings)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (["--task", "fp"], "a focus of its own"),
        (["--task", "exam"], "a focus of its own"),
        (["--task", "pp-random"], "phantom is drawn anew in every episode"),
        (["--reward", "image"], "reward must be one of 'normalized', 'paper'"),
    ],
)
def test_tasks_that_it_does_not_fit_are_refused(capsys, file, changes, said):
    assert said in refusal(capsys, *RUN, str(file), "frames=recorded", *TARGET, *changes)


def test_a_file_that_is_not_there_is_refused(capsys, tmp_path):
    assert "there is no volume" in refusal(capsys, *RUN, str(tmp_path / "none.mha"), *TARGET)
    other = tmp_path / "none.txt"
    other.write_text("")
    assert ".nii.gz" in refusal(capsys, *RUN, str(other), *TARGET)


def test_without_simple_itk_the_extra_is_named(capsys, file, monkeypatch):
    monkeypatch.setitem(sys.modules, "SimpleITK", None)
    assert "pip install 'usbench[anatomy]'" in refusal(capsys, *RUN, str(file), *TARGET)


def test_a_frame_to_look_around_needs_no_target(capsys, file, tmp_path):
    out = tmp_path / "slice.png"
    look = ["frame", "--x", "5", "--angle", "30", "--phantom", str(file), "frames=recorded"]
    assert cli.main([*look, "--plain", "--out", str(out)]) == 0
    assert "slice, (90, 40) uint8" in capsys.readouterr().out
    shown = np.asarray(Image.open(out))
    recording = own_anatomy.asked([str(file), "frames=recorded"], looking=True)
    np.testing.assert_array_equal(shown, frames_of(recording, Pose(5, 50, 30)))
    assert cli.main([*look, "--out", str(tmp_path / "figure.png")]) == 0
    assert "a recorded image has no rf" in refusal(capsys, *look, "--rf")


def test_rf_of_a_simulated_volume(capsys, file, tmp_path):
    out = tmp_path / "rf.npy"
    assert cli.main(["frame", "--rf", "--out", str(out), "--phantom", str(file), "density_per_mm3=0.01"]) == 0
    rf = np.load(out)
    assert rf.shape[1] == 64 and np.isfinite(rf).all() and rf.any()
