"""Trials in a custom anatomy: from the command line into the records, and found again."""

import base64
import shutil
from dataclasses import asdict, replace

import numpy as np
import pytest
import sweep_worker
from state_files import read_state
from stored import fresh_stores
from volumes import block, write

from usbench import cli, records, suite
from usbench.cli.phantom import custom_anatomy
from usbench.envs import frames, guidance, oracle
from usbench.envs.anatomy import tissue
from usbench.envs.pose import Pose
from usbench.guide import examination
from usbench.guide.agents import ORACLE
from usbench.guide.session import Session
from usbench.records import ConfigurationError, Trial
from usbench.report import agents, poses
from usbench.results import collecting
from usbench.setting import Setting
from usbench.setting_parts import anatomy_record
from usbench.trials import runner
from usbench.trials.configuration import resolve
from usbench.trials.model_loading import load_agent
from usbench.watch import film, replay

TARGET = ["target_x_mm=10", "target_angle_deg=30"]


@pytest.fixture(scope="module")
def _made(tmp_path_factory):
    """A volume, a trial in it, and the frames that it kept."""
    folder = tmp_path_factory.mktemp("anatomy")
    block(folder / "block.mha")
    with pytest.MonkeyPatch.context() as monkeypatch:
        _true_frames(monkeypatch, folder)
        runner.run_trial(resolved(folder / "block.mha", "frames=recorded"), folder / "runs")
    return folder


def _true_frames(monkeypatch, folder):
    """Quick trials, but with slices of the volume, kept in `folder`."""
    sweep_worker.speed_up(monkeypatch)
    monkeypatch.setenv("USBENCH_CACHE", str(folder / "cache"))
    for module in (
        "envs.guidance",
        "setting_parts.evaluation_frames",
        "trials.tensorboard",
        "guide.examination",
    ):
        monkeypatch.setattr(f"usbench.{module}.frame_store", frames.frame_store)
    fresh_stores(monkeypatch)


@pytest.fixture
def made(_made, tmp_path, monkeypatch):
    """All of it, a copy for this test alone."""
    shutil.copytree(_made, tmp_path, dirs_exist_ok=True)
    _true_frames(monkeypatch, tmp_path)
    yield tmp_path


@pytest.fixture
def trial(made):
    """The trial's folder."""
    (folder,) = records.trial_folders(made / "runs")
    return folder


@pytest.fixture
def file(made):
    """The volume, at a place of this test alone."""
    return made / "block.mha"


def asked(file, *settings):
    return custom_anatomy([str(file), *TARGET, *settings])


def resolved(file, *settings):
    return resolve("vpg", "pp", steps=64, anatomy=asked(file, *settings))


def frames_of(own, pose):
    return own.recorded_frame(pose, (90, 40), 1e-3)


def test_a_trial_tells_where_the_volume_was_and_what_was_looked_for(trial, _made):
    state = read_state(trial)
    environment = state["config"]["environment"]
    assert environment["volume"] == str(_made / "block.mha")
    assert environment["phantom"]["digest"] == tissue.read(_made / "block.mha").digest
    assert state["anchors"] == asdict(oracle.returns(suite.TASKS["pp"].guidance, target=Pose(10, 50, 30)))
    evaluations = records.load(trial)
    assert set(evaluations["target_x_mm"]) == {10} and set(evaluations["target_angle_deg"]) == {30}
    assert "phantom" not in evaluations
    # The exact plan knows the target.
    assert state["references"]["optimal"]["success_rate"] == 1


@pytest.mark.slow
def test_the_command_line_makes_the_same_trial(trial, file, capsys, tmp_path):
    run = ["run", "--algo", "vpg", "--task", "pp", "--steps", "64", "--out", str(tmp_path / "again")]
    assert cli.main([*run, "--phantom", str(file), "frames=recorded", *TARGET]) == 0
    assert str(tmp_path / "again" / trial.name / records.REPLAY) in capsys.readouterr().out
    assert (tmp_path / "again" / trial.name / records.EPISODES).read_bytes() == (
        trial / records.EPISODES
    ).read_bytes()


def test_the_same_content_is_the_same_trial_wherever_it_lies(trial, file, tmp_path):
    moved = file.rename(tmp_path / "moved.mha")
    config = resolved(moved, "frames=recorded")
    assert config.folder_name == trial.name
    assert runner.run_trial(config, trial.parent).skipped
    again = runner.run_trial(config, tmp_path / "again").folder
    for name in (records.EPISODES, records.EVALUATIONS):
        assert (again / name).read_bytes() == (trial / name).read_bytes()
    # Folders with both tell of one configuration, not of two.
    rows = [collecting.collect(folder.parent).trials for folder in (trial, again)]
    assert rows[0]["configuration"].tolist() == rows[1]["configuration"].tolist()
    others = [
        resolve("vpg", "pp", steps=64),
        resolved(moved),
        resolved(moved, "frames=recorded", "skin_mm=1"),
        resolved(moved, "frames=recorded", "target_focal_depth_mm=40"),
    ]
    assert len({config.hash, *(other.hash for other in others)}) == 5


@pytest.mark.parametrize(
    ("task", "seed", "name"),
    [
        # Of earlier trials, which people may have, and of those whose agents come with the package.
        ("fp", 0, "fp-p0-vpg-s0-6f990006"),
        ("pp", 0, "pp-p0-vpg-s0-f5fd15c6"),
        ("fp", 100, "fp-p0-vpg-s100-9aa97ea8"),
        ("pp", 107, "pp-p0-vpg-s107-805843f6"),
    ],
)
def test_the_papers_trials_are_called_as_ever(task, seed, name):
    assert resolve("vpg", task, seed=seed).folder_name == name


def test_watching_finds_the_volume_again_or_says_what_is_missing(trial, _made, capsys, made, monkeypatch):
    assert cli.main(["watch", str(trial), "--episode", "0"]) == 0
    out = capsys.readouterr().out
    steps = [int(line.split()[0]) for line in out.splitlines() if line.split() and line.split()[0].isdigit()]
    assert "optimum" in out and steps == list(range(17))
    # What is kept needs no file; without both there is a sentence.
    own = anatomy_record.recorded(read_state(trial)["config"]["environment"])
    gone = replace(own, path=str(made / "gone.mha"))
    monkeypatch.setattr(anatomy_record, "recorded", lambda _: gone)
    tissue._kept.clear()
    assert cli.main(["watch", str(trial), "--episode", "0"]) == 0
    shutil.rmtree(made / "cache")
    fresh_stores(monkeypatch)
    capsys.readouterr()
    assert cli.main(["watch", str(trial), "--episode", "0"]) == 2
    assert f"there is no volume '{gone.path}'" in capsys.readouterr().err
    write(made / "gone.mha", np.full((91, 61, 81), 100, np.uint8))
    assert cli.main(["watch", str(trial), "--episode", "0"]) == 1
    assert "has been changed: its digest must be" in capsys.readouterr().err


def test_a_replay_is_of_the_volume(trial):
    own = anatomy_record.recorded(read_state(trial)["config"]["environment"])
    record = replay.typical(Trial.read(trial).last_evaluation(deterministic=False))
    setting = Setting(task="pp", anatomy=own)
    *_, last = replay.play(setting, int(record["eval_episode"]), record["actions"])
    assert last.return_ == record["return"]
    # The optimum is that of the target.
    planned = suite.evaluation_episodes("pp")[int(record["eval_episode"])]
    assert last.optimum == pytest.approx(oracle.policy("pp", target=own.target).value(0, planned.start))


def test_a_report_plays_it_and_has_no_map_of_another_phantom(trial):
    (one,) = agents.shown(collecting.collect(trial.parent))
    looks = poses.Poses(suite.TASKS["pp"].guidance, np.zeros(0), "", np.zeros(0, bool))
    card = agents.card(trial.parent, one, looks)
    assert card.map is None and "custom anatomy" in card.silence
    record = replay.typical(Trial.read(trial).last_evaluation(deterministic=True))
    assert card.replay.total == film.fixed(record["return"])


def test_a_saved_agent_is_opened_for_the_volume(trial, file):
    loaded = load_agent(trial)
    assert loaded.config.folder_name == trial.name
    assert anatomy_record.recorded(loaded.config.environment) == asked(file, "frames=recorded")


def test_the_guide_is_in_the_volume_of_the_trial(trial, tmp_path):
    session = Session(tmp_path / "nothing", trial, seed=0)
    own = session.setting.anatomy
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
    assert "Success" in session.state()["verdict"]
    session.choose(hidden=True)
    assert session.state()["target"] is not None  # the episode has ended
    session.begin()
    assert session.state()["target"] is None


def offered(session):
    """The names of the agents that can be chosen."""
    return [agent["name"] for agent in session.state()["agents"]]


def test_agents_of_another_anatomy_do_not_advise(trial, monkeypatch):
    # Frames are not looked at here: drawn ones will do.
    sweep_worker.speed_up(monkeypatch)
    monkeypatch.setattr(examination, "frame_store", guidance.frame_store)
    released = ["best:pp", "best:pp-random", "best:pp-tracked", "vpg:pp", ORACLE]
    assert [
        name for name in offered(Session(trial.parent, seed=0)) if "pp" in name or name == ORACLE
    ] == released
    other = runner.run_trial(resolve("vpg", "pp", steps=16), trial.parent).folder
    assert other.name in offered(Session(trial.parent, seed=0))
    assert offered(Session(trial.parent, trial, seed=0)) == [trial.name, ORACLE]
