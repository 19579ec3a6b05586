"""The dynamic programme: the anchors, a brute force, and what its policy earns in the environment."""

import dataclasses
import math
import pickle

import numpy as np
import pytest
from brute_force import expectimax

from usbench.envs.oracle import DecisionProcess, Planner, policy, returns
from usbench.envs.pose import Pose
from usbench.envs.tasks.focal_point import FOCAL_POINT, FocalPointEnv
from usbench.envs.tasks.probe_plane import PROBE_PLANE, ProbePlaneEnv
from usbench.envs.tasks.random_phantoms import PROBE_PLANE_RANDOM

TARGET = Pose(0, 50, 0)


class BlankFrames:
    """Stands in for the simulator where only poses and rewards matter."""

    def frame(self, pose):
        return np.zeros((90, 40), np.uint8)


@pytest.fixture
def no_simulation(monkeypatch):
    monkeypatch.setattr("usbench.envs.guidance.frame_store", lambda *_: BlankFrames())


@pytest.mark.parametrize(
    ("task", "optimal", "random"), [("fp", -5.1333, -20.9868), ("pp", -3.7661, -20.7079)]
)
def test_anchors_of_the_specification(task, optimal, random):
    result = returns(task, 0.0)
    assert round(result.optimal, 4) == optimal
    assert round(result.random, 4) == random


def test_staying_is_worth_sixteen_times_the_start():
    # FP: mean |x| / 20 over nine starts is 100 / 180, plus 40 / 50 for the depth of 10 mm.
    assert returns("fp", 0).stay == pytest.approx(-16 * (100 / 180 + 0.8))
    # PP: mean |x| / 20 over seven starts is 60 / 140, plus the mean sine of 45, 60, 75 and 90 degrees.
    sines = (np.sqrt(0.5) + np.sqrt(0.75) + (np.sqrt(6) + np.sqrt(2)) / 4 + 1) / 4
    assert returns("pp", 0).stay == pytest.approx(-16 * (60 / 140 + sines))


def test_noise_costs_the_optimum_and_reward_in_mm_is_another_scale():
    for task in ("fp", "pp"):
        optimal = [returns(task, noise).optimal for noise in (0, 0.25, 0.5, 1)]
        assert optimal == sorted(optimal, reverse=True)
        assert all(returns(task, noise).random < returns(task, noise).optimal for noise in (0, 0.5, 1))
    # Eq. 1: 40 mm of depth take eight moves, x = 0 none: the return from there is -(35 + 30 + .. + 5) mm.
    assert policy("fp", 0, "paper").value(0, Pose(0, 10, 0)) == -140


@pytest.mark.parametrize("task", [FOCAL_POINT, PROBE_PLANE], ids=lambda task: task.name)
@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_three_steps_agree_with_brute_force(task, noise):
    short = dataclasses.replace(task, n_steps=3, starts=task.starts[:2])
    result = returns(short, noise)
    for found, choose in ((result.optimal, max), (result.random, np.mean)):
        expected = np.mean([expectimax(short, pose, 3, noise, choose) for pose in short.starts])
        assert found == pytest.approx(expected, abs=1e-12)


def run(env, best, pose, n_episodes):
    """Return the returns of `n_episodes` episodes of the oracle from `pose`."""
    earned = np.zeros(n_episodes)
    options = dataclasses.asdict(pose)
    for episode in range(n_episodes):
        env.reset(options=options)
        for step in range(best.task.n_steps):
            _, reward, *_ = env.step(best.action(step, env.pose))
            earned[episode] += reward
    return earned


@pytest.mark.parametrize("env_class", [FocalPointEnv, ProbePlaneEnv])
def test_without_noise_the_oracle_earns_exactly_its_value_from_every_start(env_class, no_simulation):
    env, task = env_class(), env_class.task
    best = policy(task.name, 0.0)
    earned = [run(env, best, pose, 1)[0] for pose in task.starts]
    for pose, value in zip(task.starts, earned, strict=True):
        assert value == pytest.approx(best.value(0, pose), abs=1e-9)
    assert np.mean(earned) == pytest.approx(returns(task.name, 0.0).optimal, abs=1e-9)


@pytest.mark.parametrize("env_class", [FocalPointEnv, ProbePlaneEnv])
@pytest.mark.parametrize("noise", [0.25, 0.5])
def test_with_noise_the_oracle_earns_its_expectation(env_class, noise, no_simulation):
    env, task = env_class(noise=noise), env_class.task
    env.reset(seed=20)
    best = policy(task.name, noise)
    deviations = []
    for pose in task.starts:
        earned = run(env, best, pose, 1_600 // len(task.starts))
        deviation = (earned.mean() - best.value(0, pose)) / (earned.std(ddof=1) / np.sqrt(earned.size))
        assert abs(deviation) < 4
        deviations.append(deviation)
    # All starts together: their standard deviations from the expectation add up like a random walk.
    assert abs(np.sum(deviations)) < 3.5 * np.sqrt(len(deviations))


def test_random_hands_earn_their_expectation(no_simulation):
    env = ProbePlaneEnv(noise=0.5)
    env.reset(seed=21)
    hand = np.random.default_rng(22)
    earned = []
    for _ in range(1_000):
        env.reset()
        earned.append(sum(env.step(int(hand.integers(5)))[1] for _ in range(16)))
    error = np.std(earned, ddof=1) / np.sqrt(len(earned))
    assert abs(np.mean(earned) - returns("pp", 0.5).random) < 3.5 * error


def test_the_policy_takes_plain_tuples_and_holds_still_at_the_goal():
    best = policy("pp", 0.0)
    assert best.action(0, (0, 50, 0)) == best.action(15, Pose(0, 50, 180)) == 0
    assert best.action(0, (5, 50, 0)) == 1
    assert best.action(0, (0, 50, 45)) == 3
    assert best.action(0, (0, 50, 135)) == 4
    assert returns("pp", 0.0) is returns("pp", 0)


@pytest.mark.parametrize("rewards", [None, (0.0,) * len(FOCAL_POINT.states)])
def test_rewards_are_read_only(rewards):
    """Processes of the same task and target share them."""
    with pytest.raises(ValueError, match="read-only"):
        DecisionProcess(FOCAL_POINT, rewards=rewards).state_rewards[:] *= 2


def test_another_target_moves_the_goal():
    best = policy("fp", 0.0, target=Pose(10, 30, 0))
    assert best.action(0, (10, 30, 0)) == 0
    assert best.action(0, (0, 30, 0)) == 2


def test_a_planner_keeps_a_byte_per_step_and_state_once_for_targets_of_equal_rewards():
    task, poses = PROBE_PLANE_RANDOM, ((0, 50, 15), (-5, 50, 210))
    planner = Planner(DecisionProcess(task, noise=0.25))
    before = len(pickle.dumps(planner))
    for angle_deg in range(0, 360, 15):
        found = [planner.action(step, pose, (5, 50, angle_deg)) for step in (0, 15) for pose in poses]
        best = policy(task, 0.25, target=Pose(5, 50, angle_deg))
        assert found == [best.action(step, pose) for step in (0, 15) for pose in poses]
    kept = len(pickle.dumps(planner)) - before
    # An object that is turned by 180 degrees is the same.
    assert kept < 12 * task.n_steps * len(task.states) + 10_000


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        (("FP", 0), ValueError, "unknown task 'FP' .did you mean 'fp'.*allowed are 'fp', 'pp', 'fp-random'"),
        ((7, 0), ValueError, "unknown task 7"),
        (("fp", 1.5), ValueError, r"noise must be a probability in \[0, 1\], not 1.5"),
        (("fp", float("nan")), ValueError, r"noise must be a probability in \[0, 1\], not nan"),
        (("fp", "0"), TypeError, r"noise must be a probability in \[0, 1\], not '0'"),
        (("fp", 0, "papre"), ValueError, "unknown reward 'papre' .did you mean 'paper'"),
    ],
)
def test_bad_arguments_are_refused(arguments, error, message):
    for function in (returns, policy):
        with pytest.raises(error, match=message):
            function(*arguments)


@pytest.mark.parametrize("part", ["actions", "states", "starts", "displacements"])
def test_a_task_without_a_part_is_refused(part):
    with pytest.raises(ValueError, match=f"the task 'pp' must have {part}"):
        dataclasses.replace(PROBE_PLANE, **{part: ()})


def test_the_parts_of_a_task_may_be_lists():
    listed = {part: list(getattr(PROBE_PLANE, part)) for part in ("states", "starts", "displacements")}
    assert returns(dataclasses.replace(PROBE_PLANE, **listed), 0.5) == returns("pp", 0.5)


def test_a_task_whose_starts_or_moves_leave_its_states_is_refused():
    with pytest.raises(ValueError, match="must be one that task 'pp' can reach, not"):
        dataclasses.replace(PROBE_PLANE, starts=(Pose(0, 35, 0),))
    few = dataclasses.replace(PROBE_PLANE, states=PROBE_PLANE.starts)
    with pytest.raises(ValueError, match="must be one that task 'pp' can reach, not"):
        policy(few)


def test_rewards_that_are_not_finite_are_refused():
    broken = dataclasses.replace(PROBE_PLANE, reward=lambda pose, target, kind: math.nan)
    with pytest.raises(ValueError, match="the rewards of the task 'pp' must be finite"):
        policy(broken)


def test_a_task_whose_rewards_are_from_frames_is_refused_where_no_environment_is_known():
    with pytest.raises(
        ValueError, match="the task 'mine' has its rewards from frames: pass them as `rewards`"
    ):
        policy(dataclasses.replace(PROBE_PLANE, name="mine", reward_from_frames=True))


def test_a_step_or_pose_outside_the_episode_is_refused():
    best = policy("fp")
    for step in (16, 1.5):
        with pytest.raises(ValueError, match=rf"step must be a whole number in \[0, 15\], not {step}"):
            best.action(step, (0, 50, 0))
    with pytest.raises(ValueError, match="pose must be one that task 'fp' can reach"):
        best.action(0, (0, 50, 15))
    with pytest.raises(ValueError, match="pose must be one that task 'fp' can reach"):
        returns("fp", starts=(Pose(1, 50, 0),))
    with pytest.raises(ValueError, match="starts must be one pose at least"):
        returns("fp", starts=())
    with pytest.raises(TypeError, match=r"target must be a Pose, not \(5, 50, 30\)"):
        returns("pp", target=(5, 50, 30))
    assert returns("fp", starts=[Pose(0, 50, 0)]) == returns("fp", starts=(Pose(0, 50, 0),))


def test_equally_good_actions_are_equal_to_the_last_bit():
    """Rounding must not choose between them: with the object at 0, left is right, and turns are mirrored."""
    found = policy("pp", 0.5, target=Pose(0, 50, 0))
    states = PROBE_PLANE.states
    mirrored = [states.index(Pose(-pose.x_mm, pose.focal_depth_mm, -pose.angle_deg % 360)) for pose in states]
    assert [action.name for action in PROBE_PLANE.actions][1:3] == ["left", "right"]
    other = found.costs[:, mirrored][:, :, [0, 2, 1, 4, 3]]
    assert np.array_equal(other == 0, found.costs == 0)
    assert found.costs == pytest.approx(other, abs=1e-12)


def test_a_pose_with_a_coordinate_missing_is_refused():
    with pytest.raises(ValueError, match=r"a Pose or \(x_mm, focal_depth_mm, angle_deg\), not \(0, 0\)"):
        policy("pp").action(0, (0, 0))
