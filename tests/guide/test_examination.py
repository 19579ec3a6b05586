"""An examination without a browser: the episode, the advice, the optimum beside it."""

import dataclasses

import numpy as np
import pytest

from usbench import suite
from usbench.envs import guidance, oracle
from usbench.envs.pose import Move, Pose
from usbench.envs.task import Action
from usbench.envs.tasks.probe_plane import PROBE_PLANE
from usbench.guide import agents, view
from usbench.guide import examination as guide
from usbench.guide.controls import controls
from usbench.guide.examination import Examination, Opened
from usbench.guide.guided import GUIDED
from usbench.setting import Setting
from usbench.watch import episode
from usbench.watch.moment import Advice

LEFT, RIGHT, TURN_BACK, TURN = 1, 2, 3, 4


@pytest.fixture(autouse=True)
def _drawn_frames(quick, monkeypatch):
    monkeypatch.setattr(guide, "frame_store", guidance.frame_store)


def exact(task, noise=0.0):
    return agents.open_oracle(Setting(task=task, noise=noise))


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
    (shown,) = controls(dataclasses.replace(PROBE_PLANE, actions=(Action("name", move),)))
    assert (shown.name, shown.advice, shown.key) == ("name", advice, key)


@pytest.mark.parametrize("task", GUIDED)
def test_keys_and_words_of_a_task_differ(task):
    guidance = suite.TASKS[task].guidance
    shown = controls(guidance)
    beside = {"up": "focus up", "down": "focus down"}
    assert [control.name for control in shown] == [
        beside.get(action.name, action.name) for action in guidance.actions
    ]
    for part in ("key", "advice", "icon"):
        assert len({getattr(control, part) for control in shown}) == len(shown)


def test_scanners_settings_have_no_keys():
    assert set(suite.TASKS) - set(GUIDED) == {"setup", "setup-v0"}


@pytest.mark.parametrize("task", sorted(set(GUIDED) - set(suite.PAPER)))
def test_who_follows_the_optimum_succeeds_in_the_other_tasks_too(task):
    examination = Examination(Setting(task=task, noise=0.0), 5, exact(task))
    while not examination.over:
        examination.follow()
    assert examination.at_goal and examination.return_ == pytest.approx(examination.optimum[-1])
    assert examination.score(examination.return_) > 0.5


def test_stopping_ends_the_episode_and_is_judged_there():
    examination = Examination(Setting(task="exam-stop"), 5)
    examination.act(7)
    assert examination.over and not examination.at_goal and examination.advice is None
    with pytest.raises(ValueError, match="over after 1 steps"):
        examination.act(0)
    assert examination.return_ < examination.optimum[-1]
    # Stopping earned the rewards of all 24 steps, and so does the optimum beside it.
    shown = view.seen(examination, hidden=False, for_good=False)
    assert shown["optimum"] == f"{examination.optimum[-1]:.2f}" != f"{examination.optimum[1]:.2f}"
    examination.ask(None)  # another agent sees the same end
    assert examination.over


@pytest.mark.parametrize("noise", [0.0, 0.5])
@pytest.mark.parametrize("task", suite.PAPER)
def test_who_follows_the_optimum_gets_its_return_and_succeeds(task, noise):
    examination = Examination(Setting(task=task, noise=noise), 3, exact(task, noise))
    for step in range(16):
        assert examination.return_ == examination.optimum[step]
        examination.follow()
    assert examination.over and examination.advice is None
    assert examination.return_ == examination.optimum[16]
    if noise == 0:
        assert examination.at_goal


def test_optimum_is_the_plans_value_at_the_start():
    examination = Examination(Setting(task="fp", noise=0.0), 1)
    assert examination.optimum[-1] == pytest.approx(oracle.policy("fp").value(0, examination.pose))


def test_optimum_simulates_no_frame(monkeypatch):
    def simulated(*_):
        raise AssertionError("a frame was asked for")

    monkeypatch.setattr(guidance, "frame_store", simulated)
    setting = Setting(task="exam", noise=0.5)
    assert len(episode.optimum(setting, 3)) == setting.guidance.n_steps + 1


@pytest.mark.parametrize("noise", [0.0, 0.25])
def test_score_is_0_for_the_random_agent_and_1_for_the_optimum_from_this_start(noise):
    examination = Examination(Setting(task="pp", noise=noise), 0)
    anchors = oracle.returns("pp", noise, starts=(examination.pose,))
    assert examination.score(anchors.random) == 0
    assert examination.score(anchors.optimal) == 1
    best = oracle.policy("pp", noise).value(0, examination.pose)
    assert anchors.optimal == pytest.approx(best)


def test_optimum_tells_the_return_of_each_action():
    """By hand, without noise: the reward of the action, then the best return from where the action leads."""
    examination, policy = Examination(Setting(task="pp"), 2, exact("pp")), oracle.policy("pp")
    assert examination.advice.kind == "return"
    task, pose = examination.guidance, examination.pose
    for action, told in zip(task.actions, examination.advice.weights, strict=True):
        there = pose.moved(action.move, task.limits)
        assert told == pytest.approx(
            task.reward(there, Pose(0, 50, 0), "normalized") + policy.value(1, there)
        )
    assert max(examination.advice.weights) == pytest.approx(policy.value(0, pose))
    assert view.advice(examination)["texts"][0] == f"{examination.advice.weights[0]:.2f}"


def test_actions_move_the_probe_and_the_frame():
    examination = Examination(Setting(task="pp", noise=0.0), 0)
    start, frame = examination.pose, examination.frame
    examination.act(TURN)
    assert examination.pose == Pose(start.x_mm, 50, start.angle_deg + 15)
    assert examination.frame.shape == (90, 40) and not np.array_equal(examination.frame, frame)


def test_move_beyond_the_limits_is_told():
    examination = Examination(Setting(task="pp", noise=0.0), 0)
    for _ in range(10):
        examination.act(LEFT)
    assert examination.pose.x_mm == -20 and examination.blocked
    assert "limit" in view.seen(examination, hidden=False)["happened"]
    examination.act(0)
    assert not examination.blocked


def test_slip_is_told_in_words():
    examination = Examination(Setting(task="pp", noise=1.0), 0)
    examination.act(0)
    assert any(word in examination.slip for word in ("left", "right", "clockwise"))
    assert f"slipped, {examination.slip}." in view.seen(examination, hidden=False)["happened"]


@pytest.mark.parametrize(("action", "error"), [(5, ValueError), (-1, ValueError), ("left", TypeError)])
def test_unknown_action_is_refused(action, error):
    with pytest.raises(error, match="action must be"):
        Examination(Setting(task="pp", noise=0.0), 0).act(action)


def test_episode_ends_after_16_steps():
    examination = Examination(Setting(task="pp", noise=0.0), 0)
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
    examination = Examination(Setting(task="pp", noise=0.5), 2, exact("pp"))
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
        Examination(Setting(task="pp", noise=0.0), 0).follow()


def test_bars_are_probabilities_or_lie_between_least_and_most_expected():
    examination = Examination(Setting(task="pp", noise=0.0), 0, Opened(Remembering()))
    shown = view.advice(examination)
    assert shown["bars"] == [0.1, 0.2, 0.3, 0.4, 0.0] and shown["texts"][3] == "40 %"
    assert (shown["words"], shown["icon"]) == ("rotate counter-clockwise", "counter-clockwise")
    examination.advice = Advice((-4.0, -3.0, -2.0, -4.0, -3.5), "value")
    shown = view.advice(examination)
    assert shown["bars"] == [0, 0.5, 1, 0, 0.25] and shown["texts"][2] == "-2.00"
