"""An examination without a browser: the episode, the advice, the optimum beside it, and who may advise."""

import json
import sys
import time

import numpy as np
import pytest

from usbench import guide, guide_agents, guide_training, guide_view, records, suite
from usbench.advice import Advice
from usbench.envs import guidance, oracle
from usbench.envs.guidance import Action
from usbench.envs.pose import Move, Pose
from usbench.guide import Examination, Opened
from usbench.guide_agents import ORACLE, Known
from usbench.guide_controls import control
from usbench.guide_session import Session
from usbench.records import ConfigurationError

LEFT, RIGHT, TURN_BACK, TURN = 1, 2, 3, 4


@pytest.fixture(autouse=True)
def _drawn_frames(quick, monkeypatch):
    monkeypatch.setattr(guide, "frame_store", guidance.frame_store)


@pytest.fixture
def session(tmp_path):
    session = Session(tmp_path, seed=0)
    yield session
    session.close()


def exact(task, noise=0.0):
    return guide_agents.open_oracle(task, noise)


@pytest.mark.parametrize(
    ("move", "advice", "key"),
    [
        (Move(), "hold still", " "),
        (Move(x_mm=-5), "move left", "ArrowLeft"),
        (Move(x_mm=5), "move right", "ArrowRight"),
        (Move(focal_depth_mm=-5), "move the focus up", "ArrowUp"),
        (Move(focal_depth_mm=5), "move the focus down", "ArrowDown"),
        (Move(angle_deg=-15), "rotate counter-clockwise", "e"),
        (Move(angle_deg=15), "rotate clockwise", "r"),
    ],
)
def test_every_move_has_words_and_a_key(move, advice, key):
    shown = control(Action("name", move))
    assert (shown.name, shown.advice, shown.key) == ("name", advice, key)


@pytest.mark.parametrize("task", list(suite.TASKS))
def test_keys_of_a_task_differ(task):
    actions = suite.TASKS[task].guidance.actions
    assert len({control(action).key for action in actions}) == len(actions) == 5


@pytest.mark.parametrize("noise", [0.0, 0.5])
@pytest.mark.parametrize("task", list(suite.TASKS))
def test_who_follows_the_optimum_gets_its_return_and_succeeds(task, noise):
    examination = Examination(task, noise, 3, exact(task, noise))
    for step in range(16):
        assert examination.return_ == examination.optimum[step]
        examination.follow()
    assert examination.over and examination.advice is None
    assert examination.return_ == examination.optimum[16]
    if noise == 0:
        assert examination.at_goal


def test_optimum_is_the_plans_value_at_the_start():
    examination = Examination("fp", 0.0, 1)
    assert examination.optimum[-1] == pytest.approx(oracle.policy("fp").value(0, examination.pose))


def test_score_is_0_for_a_random_hand_and_1_for_the_optimum():
    examination, anchors = Examination("pp", 0.25, 0), oracle.returns("pp", 0.25)
    assert examination.score(anchors.random) == 0
    assert examination.score(anchors.optimal) == 1


def test_actions_move_the_probe_and_the_frame():
    examination = Examination("pp", 0.0, 0)
    start, frame = examination.pose, examination.frame
    examination.act(TURN)
    assert examination.pose == Pose(start.x_mm, 50, start.angle_deg + 15)
    assert examination.frame.shape == (90, 40) and not np.array_equal(examination.frame, frame)


def test_move_beyond_the_limits_is_told():
    examination = Examination("pp", 0.0, 0)
    for _ in range(10):
        examination.act(LEFT)
    assert examination.pose.x_mm == -20 and examination.blocked
    assert "limit" in guide_view.seen(examination, hidden=False)["happened"]
    examination.act(0)
    assert not examination.blocked


def test_slip_is_told_in_words():
    examination = Examination("pp", 1.0, 0)
    examination.act(0)
    assert any(word in examination.slip for word in ("left", "right", "clockwise"))
    assert f"slipped, {examination.slip}." in guide_view.seen(examination, hidden=False)["happened"]


@pytest.mark.parametrize(("action", "error"), [(5, ValueError), (-1, ValueError), ("left", TypeError)])
def test_unknown_action_is_refused(action, error):
    with pytest.raises(error, match="action must be"):
        Examination("pp", 0.0, 0).act(action)


def test_episode_ends_after_16_steps():
    examination = Examination("pp", 0.0, 0)
    for _ in range(16):
        examination.act(0)
    with pytest.raises(ValueError, match="over after 16 steps"):
        examination.act(0)


class Remembering:
    """Advises what it has not seen yet, and notes what it is shown."""

    def __init__(self):
        self.shown = []

    def begin(self):
        self.shown = []

    def advise(self, observation, info, step):
        self.shown.append((observation.shape[2], step, info["x_mm"]))
        return Advice((0.1, 0.2, 0.3, 0.4, 0.0))


def test_new_adviser_is_shown_the_episode_from_its_start():
    examination = Examination("pp", 0.5, 2, exact("pp"))
    poses = [examination.pose.x_mm]
    for action in (RIGHT, TURN, TURN):
        examination.act(action)
        poses.append(examination.pose.x_mm)
    pose, return_ = examination.pose, examination.return_
    adviser = Remembering()
    examination.ask(Opened(adviser, n_frames=2))
    assert adviser.shown == [(2, step, x_mm) for step, x_mm in enumerate(poses)]
    assert (examination.pose, examination.return_, examination.actions) == (pose, return_, [2, 4, 4])
    assert examination.advice.best == 3


def test_without_advice_there_is_nothing_to_follow():
    with pytest.raises(ValueError, match="nothing is advised"):
        Examination("pp", 0.0, 0).follow()


def test_bars_are_probabilities_or_lie_between_least_and_most_expected():
    examination = Examination("pp", 0.0, 0, Opened(Remembering()))
    shown = guide_view.advice(examination)
    assert shown["bars"] == [0.1, 0.2, 0.3, 0.4, 0.0] and shown["texts"][3] == "40 %"
    assert (shown["words"], shown["icon"]) == ("rotate counter-clockwise", "counter-clockwise")
    examination.advice = Advice((-4.0, -3.0, -2.0, -4.0, -3.5), "value")
    shown = guide_view.advice(examination)
    assert shown["bars"] == [0, 0.5, 1, 0, 0.25] and shown["texts"][2] == "-2.00"


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
    assert session.state()["verdict"].startswith("Success: the probe is at the goal. Score ")


def test_trial_advises_on_its_own_task_and_noise(finished, tmp_path):
    session = Session(tmp_path / "nothing", finished, seed=0)
    state = session.state()
    assert (state["task"], state["noise"], state["agent"]) == ("pp", 0.5, finished.name)
    assert state["advice"]["kind"] == "probability"
    assert sum(state["advice"]["bars"]) == pytest.approx(1)
    assert not state["training"]["offered"]


def test_trial_of_the_runs_advises_by_itself(finished):
    assert Session(finished.parent, seed=0).agent == finished.name


def test_model_of_another_task_is_refused_in_words(finished):
    session = Session(finished.parent, seed=0)
    session.choose(task="fp")
    assert session.agent == ORACLE and f"{finished.name} was trained on another task" in session.message
    session.choose(agent=finished.name)
    assert "does not fit" in session.message and "'Probe plane' (pp)" in session.message
    assert session.state()["advice"] is None
    session.choose(task="pp", agent=finished.name)
    assert session.message == "" and session.state()["advice"]


def test_model_that_cannot_be_opened_is_told(finished):
    session = Session(finished.parent, seed=0)
    (finished / records.MODEL).write_bytes(b"no zip")
    session.choose(agent=finished.name)
    assert "not a readable zip file" in session.message and session.state()["advice"] is None
    with pytest.raises(ConfigurationError, match="not a readable zip file"):
        Session(finished.parent, finished)


def test_another_agent_goes_on_with_the_episode_another_task_does_not(finished):
    session = Session(finished.parent, seed=0)
    session.act(TURN)
    session.choose(agent=ORACLE)
    assert session.examination.actions == [TURN]
    session.choose(noise=0.25)
    assert session.examination.actions == [] and session.state()["noise"] == 0.25


@pytest.mark.parametrize(
    "choice", [{"task": "xx"}, {"noise": 2}, {"noise": "much"}, {"agent": "../elsewhere"}, {"task": []}]
)
def test_unknown_choice_is_refused_and_changes_nothing(session, choice):
    with pytest.raises(ConfigurationError, match="must be|allowed are"):
        session.choose(**choice)
    assert session.state()["message"] == "" and session.state()["task"] == "pp"


def test_folder_that_is_no_trial_is_refused(tmp_path):
    with pytest.raises(ConfigurationError, match="not the folder of a trial"):
        Session(tmp_path, tmp_path)


def test_seed_that_is_none_is_refused(tmp_path):
    with pytest.raises(ConfigurationError, match="seed"):
        Session(tmp_path, seed=-1)


def test_broken_trials_are_left_out(finished):
    for number, text in enumerate(("{", "[]", '{"schema": 1}', '{"schema": 1, "config": {"algo": 3}}')):
        folder = finished.parent / f"broken{number}"
        folder.mkdir()
        (folder / records.TRIAL).write_text(text)
    (trial,) = guide_agents.find([finished.parent])
    assert trial.name == finished.name and trial.label.startswith("vpg, seed 0, noise 0.5, score ")
    evaluations = records.load(finished)
    last = evaluations[(evaluations["checkpoint"] == 128) & evaluations["deterministic"]]
    assert trial.score == pytest.approx(last["normalized_score"].mean())


def test_best_agent_is_of_the_task_and_rather_of_the_noise(tmp_path):
    trials = [
        Known(tmp_path / name, task, noise, "", score)
        for name, task, noise, score in [
            ("a", "pp", 0.25, 0.5),
            ("b", "pp", 0.25, 0.6),
            ("c", "pp", 0.0, 0.9),
            ("d", "fp", 0.25, 1.0),
            ("e", "pp", 0.25, None),
        ]
    ]
    assert guide_agents.best(trials, "pp", 0.25).name == "b"
    assert guide_agents.best(trials, "pp", 0.5).name == "c"
    assert guide_agents.best(trials[:3], "fp", 0.0) is None


def wait_for_training(session):
    session.train()
    deadline = time.monotonic() + 60
    while session.state()["training"]["status"] == "running" and time.monotonic() < deadline:
        time.sleep(0.02)
    return session.state()["training"]


def test_trained_agent_takes_over_from_the_optimum(session, finished, monkeypatch):
    # In place of `usbench run`: a trial appears where that would leave it.
    copy = f"import shutil, sys; shutil.copytree({str(finished)!r}, sys.argv[-2] + '/' + NAME)"
    name = guide_training.resolve("dqn", "pp", steps=guide_training.STEPS).folder_name
    monkeypatch.setattr(guide_training, "USBENCH", [sys.executable, "-c", copy.replace("NAME", repr(name))])
    assert wait_for_training(session)["status"] == "finished"
    assert session.agent == name and session.message.startswith("Trained: ")
    assert not session.state()["training"]["offered"]


def test_training_that_fails_says_why(session, monkeypatch):
    fail = "import sys; sys.exit('usbench: error: no space is left.')"
    monkeypatch.setattr(guide_training, "USBENCH", [sys.executable, "-c", fail])
    training = wait_for_training(session)
    assert (training["status"], training["reason"]) == ("failed", "usbench: error: no space is left.")
    assert session.agent == ORACLE


def test_closing_ends_the_training(session, monkeypatch):
    monkeypatch.setattr(guide_training, "USBENCH", [sys.executable, "-c", "import time; time.sleep(600)"])
    session.train()
    process = session.training._process
    assert session.state()["training"]["status"] == "running"
    session.close()
    assert process.returncode is not None
