"""Who advises in the guide: trials, the optimum, and an agent that is trained meanwhile."""

import json
import re
import shutil
import sys
import time
from pathlib import Path

import pytest
from quick_trials import speed_up
from state_files import read_state, write_state

from usbench import records, released
from usbench.envs import guidance
from usbench.envs.bmode import Imaging
from usbench.envs.probe import LinearArray
from usbench.guide import agents, examination
from usbench.guide import training as guide_training
from usbench.guide.agents import ORACLE, Known
from usbench.guide.session import Session
from usbench.records import ConfigurationError
from usbench.setting import Setting
from usbench.trials import runner
from usbench.trials.configuration import resolve

LEFT, RIGHT, TURN_BACK, TURN = 1, 2, 3, 4


@pytest.fixture(autouse=True)
def _drawn_frames(quick, monkeypatch):
    monkeypatch.setattr(examination, "frame_store", guidance.frame_store)


@pytest.fixture
def session(tmp_path):
    session = Session(tmp_path, seed=0)
    yield session
    session.close()


def test_without_a_trial_the_optimum_advises_and_a_training_is_offered(session):
    state = session.state()
    assert state["agent"] == ORACLE and state["exact"] and state["training"]["offered"]
    assert json.loads(json.dumps(state))["step"] == 0


def test_hidden_object_is_told_by_nothing_until_the_end(session):
    session.choose(hidden=True)
    session.act(RIGHT)
    state = session.state()
    assert state["balls"] == [] and state["hidden"]
    assert state["return"] is state["optimum"] is state["at_goal"] is None
    for _ in range(15):
        session.follow()
    state = session.state()
    assert state["verdict"].startswith("of the best from this start. Success: the probe is at ")
    assert state["hidden"] and len(state["balls"]) == 6


def test_trial_advises_on_its_own_task_and_noise(finished, tmp_path):
    session = Session(tmp_path / "nothing", finished, seed=0)
    state = session.state()
    assert (state["task"], state["noise"], state["agent"]) == ("pp", 0.5, finished.name)
    assert state["advice"]["kind"] == "probability"
    assert sum(state["advice"]["bars"]) == pytest.approx(1)
    assert not state["training"]["offered"]


def test_trial_of_the_runs_advises_by_itself(finished):
    assert Session(finished.parent, seed=0).advisers.name == finished.name


def test_model_of_another_task_is_refused_in_words(finished):
    session = Session(finished.parent, seed=0)
    session.choose(task="fp")
    assert (
        session.advisers.name == ORACLE
        and f"{finished.name} was trained on another task" in session.advisers.message
    )
    session.choose(agent=finished.name)
    assert "does not fit" in session.advisers.message and "'Probe plane' (pp)" in session.advisers.message
    assert session.state()["advice"] is None
    session.choose(task="pp", agent=finished.name)
    assert session.advisers.message == "" and session.state()["advice"]


def test_a_trained_agent_of_another_task_takes_over_without_an_alarm(finished, trial_on, tmp_path):
    runs = tmp_path / "both"
    for trial in (finished, other := trial_on("fp")):
        shutil.copytree(trial, runs / trial.name)
    session = Session(runs, seed=0)
    session.choose(task="fp")
    assert session.advisers.name == other.name and session.advisers.message == ""
    told = f"{other.name} advises here: {finished.name} was trained on another task."
    assert session.advisers.notice == told
    session.choose(noise=0.25)
    assert session.advisers.notice == ""


def test_the_chosen_agent_stays_where_the_other_task_is_its_own(finished, trial_on, tmp_path):
    runs, other = tmp_path / "both", trial_on("fp")
    for trial in (finished, other):
        shutil.copytree(trial, runs / trial.name)
    again = shutil.copytree(other, runs / "fp-again")
    # One of the two is the best of its task.
    for name in (other.name, again.name):
        session = Session(runs, task="pp", seed=0)
        session.choose(agent=name)
        assert session.advisers.message
        session.choose(task="fp")
        assert (session.advisers.name, session.advisers.message, session.advisers.notice) == (name, "", "")


def test_model_that_cannot_be_opened_is_told(finished):
    session = Session(finished.parent, seed=0)
    (finished / records.MODEL).write_bytes(b"no zip")
    session.choose(agent=finished.name)
    assert "not a readable zip file" in session.advisers.message and session.state()["advice"] is None
    with pytest.raises(ConfigurationError, match="not a readable zip file"):
        Session(finished.parent, finished)


def test_another_agent_goes_on_with_the_episode_another_task_does_not(finished):
    session = Session(finished.parent, seed=0)
    session.act(TURN)
    session.choose(agent=ORACLE)
    assert session.examination.actions == [TURN]
    session.choose(noise=0.25)
    assert session.examination.actions == [] and session.state()["noise"] == 0.25


def test_page_that_shows_another_agent_s_advice_is_out_of_date(finished):
    """Else its button "follow" would take a step that nobody saw."""
    session = Session(finished.parent, finished)
    before = session.place
    session.choose(agent="oracle")
    assert session.place != before


@pytest.mark.parametrize(
    "choice", [{"task": "xx"}, {"noise": 2}, {"noise": "much"}, {"agent": "../elsewhere"}, {"task": []}]
)
def test_unknown_choice_is_refused_and_changes_nothing(session, choice):
    with pytest.raises(ConfigurationError, match="must be|allowed are"):
        session.choose(**choice)
    assert session.state()["message"] == "" and session.state()["task"] == "pp"


WIDE = LinearArray(n_lines=96)
SQUARE = Imaging(height_px=128, width_px=128, pixel_size=0.5e-3)


@pytest.fixture(scope="module")
def square(tmp_path_factory):
    """The folder of a trial with a probe and an imaging that are not the default."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        speed_up(monkeypatch)
        config = resolve("vpg", "pp", steps=64, probe=WIDE, imaging=SQUARE)
        return runner.run_trial(config, tmp_path_factory.mktemp("runs")).folder


def test_trial_opens_with_its_own_probe_and_imaging(square, tmp_path):
    session = Session(tmp_path / "nothing", square, seed=0)
    assert (session.setting.probe, session.setting.imaging) == (WIDE, SQUARE)
    state = session.state()
    assert state["shape"] == (128, 128) and state["frame_mm"] == [64, 64] and state["probe"]["width"] == 60
    assert state["agent"] == square.name and state["advice"]
    session.choose(task="fp", noise=0.25)
    assert session.state()["shape"] == (128, 128)


def test_agents_of_another_probe_or_imaging_do_not_advise(square, finished):
    for runs, own, what in [
        (square.parent, {}, "imaging or probe"),
        (square.parent, {"probe": WIDE}, "imaging"),
        (finished.parent, {"probe": WIDE}, "probe"),
    ]:
        state = Session(runs, seed=0, **own).state()
        assert state["agent"] == ORACLE and [agent["name"] for agent in state["agents"]] == [ORACLE]
        assert state["untrained"].startswith(f"Every agent of this task was trained with another {what};")
    with pytest.raises(ConfigurationError, match=r"does not fit: .* trained with another imaging\.$"):
        Session(square.parent, square, imaging=Imaging())


def test_training_is_for_the_default_probe_and_imaging(tmp_path):
    session = Session(tmp_path, seed=0, imaging=SQUARE)
    state = session.state()
    assert not state["training"]["offered"] and state["untrained"].startswith("No agent is trained")
    with pytest.raises(ConfigurationError, match="default anatomy, probe and imaging"):
        session.train()


@pytest.mark.parametrize("seen", [{"senses": ("actions",)}, {"n_frames": 2}, {"n_phantoms": 3}])
def test_training_is_for_any_agent_of_a_task_as_it_is(seen):
    assert guide_training.can_train(Setting(task="pp-random", **seen))
    assert not guide_training.can_train(Setting(task="pp-random", imaging=SQUARE, **seen))


@pytest.mark.parametrize("changes", [{"senses": ("heading",)}, {"task": "pp-random", "n_phantoms": 3}])
def test_another_task_has_its_own_senses_and_phantoms(tmp_path, changes):
    config = resolve("vpg", steps=64, **{"task": "pp", **changes})
    session = Session(tmp_path, runner.run_trial(config, tmp_path).folder, seed=0)
    for task in ("fp", "pp-tracked"):
        session.choose(task=task)
        assert session.setting == Setting(task=task) and guide_training.can_train(session.setting)


def test_a_trial_of_an_algorithm_from_elsewhere_is_no_adviser(finished):
    state = read_state(finished)
    state["config"]["algo"] = "mine:Long"
    write_state(finished, state)
    assert agents.find(finished.parent) == []


def test_a_trial_with_the_name_of_the_exact_optimum_is_not_taken_for_it(finished):
    folder = finished.rename(finished.with_name("oracle"))
    assert agents.find(folder.parent) == []
    with pytest.raises(ConfigurationError, match="must not be named 'oracle'"):
        Session(folder.parent, folder)


def test_folder_that_is_no_trial_is_refused(tmp_path):
    with pytest.raises(ConfigurationError, match="not the folder of a trial"):
        Session(tmp_path, tmp_path)


def test_seed_that_is_none_is_refused(tmp_path):
    with pytest.raises(ConfigurationError, match="seed"):
        Session(tmp_path, seed=-1)


def test_broken_trials_are_left_out(finished):
    texts = ("{", "[]", "[" * 100_000, '{"schema": 1}', '{"schema": 1, "config": {"algo": 3}}')
    for number, text in enumerate(texts):
        folder = finished.parent / f"broken{number}"
        folder.mkdir()
        (folder / records.TRIAL).write_text(text)
    (trial,) = agents.find(finished.parent)
    assert trial.name == finished.name and trial.label.startswith("vpg, 128 steps, seed 0, noise 0.5, score ")
    evaluations = records.load(finished)
    last = evaluations[(evaluations["checkpoint"] == 128) & evaluations["deterministic"]]
    assert trial.score == pytest.approx(last["normalized_score"].mean())


def test_an_agent_whose_last_line_was_torn_is_known(finished):
    (whole,) = agents.find(finished.parent)
    with (finished / records.EVALUATIONS).open("a") as file:
        file.write('{"episode": 12, "ret')
    assert agents.find(finished.parent) == [whole]


@pytest.mark.parametrize("value", ["1e999", "-Infinity", "NaN"])
def test_a_return_that_is_no_number_makes_no_best_agent(finished, value):
    path = finished / records.EVALUATIONS
    last = re.sub(r'"return": [^,]+', f'"return": {value}', path.read_text())
    path.write_text(last)
    (trial,) = agents.find(finished.parent)
    assert trial.score is None


def test_trials_that_would_look_alike_are_told_apart(finished, tmp_path):
    runs, names = tmp_path / "runs", ("first", "second", "shorter", "broken-off")
    for name in names:
        shutil.copytree(finished, runs / name)
    state = read_state(finished)
    write_state(runs / "shorter", {**state, "config": {**state["config"], "steps": 64}})
    write_state(runs / "broken-off", {**state, "status": "interrupted"})
    shown = {one["name"]: one["label"] for one in Session(runs, seed=0).state()["agents"]}
    score = agents.known(finished).label.rpartition(", ")[2]
    assert [shown[name] for name in names] == [
        f"vpg, 128 steps, seed 0, noise 0.5, {score} (first)",
        f"vpg, 128 steps, seed 0, noise 0.5, {score} (second)",
        f"vpg, 64 steps, seed 0, noise 0.5, {score}",
        f"vpg, 128 steps, seed 0, noise 0.5, interrupted, {score}",
    ]


def test_best_agent_is_of_the_task_and_rather_of_the_noise(tmp_path):
    trials = [
        Known(tmp_path / name, Setting(task=task, noise=noise), "", score)
        for name, task, noise, score in [
            ("a", "pp", 0.25, 0.5),
            ("b", "pp", 0.25, 0.6),
            ("c", "pp", 0.0, 0.9),
            ("d", "fp", 0.25, 1.0),
            ("e", "pp", 0.25, None),
        ]
    ]
    assert agents.best(trials, Setting(task="pp", noise=0.25)).name == "b"
    assert agents.best(trials, Setting(task="pp", noise=0.5)).name == "c"
    assert agents.best(trials[:3], Setting(task="fp")) is None
    taught = Known(tmp_path / "f", Setting(task="pp", noise=0.25), "", 0.7, is_taught=True)
    assert agents.best([*trials, taught], Setting(task="pp", noise=0.25)).name == "b"
    assert agents.best([taught], Setting(task="pp", noise=0.25)) is taught


def wait_for_training(session):
    session.train()
    deadline = time.monotonic() + 60
    while session.state()["training"]["status"] == "running" and time.monotonic() < deadline:
        time.sleep(0.02)
        session.update()
    return session.state()["training"]


def leaving(finished, monkeypatch, then=""):
    """Let a training leave `finished` where `usbench run` would, all at once; return the name there."""
    name = resolve("dqn", "pp", steps=guide_training.STEPS).folder_name
    copy = (
        f"import os, shutil, sys; runs = sys.argv[-2]; shutil.copytree({str(finished)!r}, runs + '.part'); "
        f"os.makedirs(runs, exist_ok=True); os.rename(runs + '.part', runs + '/{name}')"
        f"{then}"
    )
    monkeypatch.setattr(guide_training, "USBENCH", [sys.executable, "-c", copy])
    return name


def test_trained_agent_takes_over_from_the_optimum(session, finished, monkeypatch):
    name = leaving(finished, monkeypatch)
    assert wait_for_training(session)["status"] == "finished"
    assert (
        session.advisers.name == name
        and session.advisers.notice.startswith("Trained: ")
        and not session.advisers.message
    )
    assert not session.state()["training"]["offered"]


def test_beside_an_agent_of_the_package_one_of_your_own_can_be_trained(tmp_path, finished, monkeypatch):
    monkeypatch.setattr(released, "FOLDER", Path(released.__file__).with_name("trained"))
    session = Session(tmp_path / "mine", seed=0)
    assert session.advisers.name == "best:pp" and session.state()["training"]["offered"]
    name = leaving(finished, monkeypatch)
    assert wait_for_training(session)["status"] == "finished" and not session.state()["training"]["offered"]
    assert session.advisers.name == "best:pp" and session.advisers.notice.endswith(
        " can be chosen as the agent."
    )
    session.choose(agent=name)
    assert session.advisers.name == name
    session.close()


def test_asking_for_the_state_switches_nothing(session, finished, monkeypatch):
    name = leaving(finished, monkeypatch)
    session.train()
    session.training._process.wait(timeout=60)
    assert session.state() == session.state()
    assert session.advisers.name == ORACLE and session.state()["training"]["status"] == "running"
    session.update()
    assert session.advisers.name == name and session.state() == session.state()
    session.choose(agent=ORACLE)
    session.update()
    assert session.advisers.name == ORACLE


def test_training_that_leaves_no_model_changes_nothing(session, finished, monkeypatch):
    (finished / records.MODEL).unlink()
    leaving(finished, monkeypatch)
    assert wait_for_training(session)["status"] == "finished"
    assert session.advisers.name == ORACLE and session.advisers.message == ""


def test_training_that_fails_says_why(session, monkeypatch):
    fail = "import sys; sys.exit('usbench: error: no space is left.')"
    monkeypatch.setattr(guide_training, "USBENCH", [sys.executable, "-c", fail])
    training = wait_for_training(session)
    assert (training["status"], training["reason"]) == ("failed", "no space is left.")
    # What lies there is damaged, so that no progress can be read.
    folder = session.training.progress.folder
    folder.mkdir()
    (folder / records.TRIAL).write_text("{")
    training = wait_for_training(session)
    assert (training["status"], training["reason"]) == ("failed", "no space is left.")
    assert session.advisers.name == ORACLE


def test_closing_ends_the_training(session, monkeypatch):
    monkeypatch.setattr(guide_training, "USBENCH", [sys.executable, "-c", "import time; time.sleep(600)"])
    session.train()
    process = session.training._process
    assert session.state()["training"]["status"] == "running"
    session.close()
    assert process.returncode is not None


def test_another_training_lets_the_one_before_draw_its_figures(session, finished, monkeypatch):
    leaving(finished, monkeypatch, then="; import time; time.sleep(600)")
    assert wait_for_training(session)["status"] == "finished"
    drawing = session.training._process
    session.train()
    assert session.training._process is not drawing and drawing.poll() is None
    session.close()
    assert drawing.returncode is not None


def test_a_trial_of_an_agent_that_does_not_learn_is_refused(quick, tmp_path):
    folder = runner.run_trial(resolve("random", "pp"), tmp_path).folder
    with pytest.raises(ConfigurationError, match="is not the trial of an agent that learns"):
        agents.known(folder)
