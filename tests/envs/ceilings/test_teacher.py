"""The teacher against brute force over beliefs, against the ceilings, and against its own episodes."""

from dataclasses import replace
from functools import cache
from itertools import product

import numpy as np
import pytest

from usbench.envs.ceilings import beliefs, hypotheses
from usbench.envs.ceilings.depths import focus_held
from usbench.envs.ceilings.teacher import Teacher
from usbench.envs.pose import Move, Pose
from usbench.envs.tasks.examination import EXAMINATION
from usbench.envs.tasks.phantom_distribution import PhantomDistribution
from usbench.envs.tasks.random_phantoms import (
    FOCAL_POINT_RANDOM,
    PROBE_PLANE_RANDOM,
    PROBE_PLANE_TRACKED,
    ProbePlaneRandomEnv,
)

TRACKED = ("position", "heading")
DRAWN = PhantomDistribution((-10, 0), (45, 50), tuple(range(0, 180, 30)))
# Two places, two depths and two planes of the object, few poses, few steps: small enough for brute force.
FEW = PhantomDistribution((5,), (45, 55), (0, 45))
FOCI = (45, 50, 55)
STATES = tuple(Pose(x, f, a) for f in FOCI for x in (-20, -15, -10) for a in range(0, 360, 15))
SMALL = replace(
    EXAMINATION,
    name="small",
    states=STATES,
    starts=tuple(pose for pose in STATES if pose.angle_deg % 75 == 0),
    limits=replace(EXAMINATION.limits, x_mm=(-20, -10), focal_depth_mm=(45, 55)),
    n_steps=2,
)


@pytest.fixture(scope="module")
def teacher():
    return Teacher(PROBE_PLANE_TRACKED, DRAWN, TRACKED)


def info(pose, target):
    coordinates = ("x_mm", "focal_depth_mm", "angle_deg")
    return {name: getattr(pose, name) for name in coordinates} | {
        f"target_{name}": getattr(target, name) for name in coordinates
    }


def pairs(teacher):
    """Every start with every object."""
    angles = sorted({angle % 180 for angle in teacher.phantoms.angle_deg})
    targets = [Pose(*one) for one in product(teacher.phantoms.x_mm, teacher.phantoms.depth_mm, angles)]
    return list(product(teacher.task.starts, targets))


def brute_force(task, noise, looks, members, steps):
    """Mean return of the best policy that remembers all, by trying every action; members are weighted."""
    if steps == 0:
        return 0.0
    best = -np.inf
    outcomes = [(1 - noise, Move())]
    outcomes += [(noise / len(task.displacements), one) for one in task.displacements] if noise else []
    for action in task.actions:
        total, after = 0.0, {}
        for (pose, target), weight in members.items():
            moved = pose.moved(action.move, task.limits)
            total += weight * task.reward(moved, target, "normalized")
            for share, move in outcomes:
                landed = moved.moved(move, task.limits)
                group = after.setdefault(looks(landed, target), {})
                group[landed, target] = group.get((landed, target), 0.0) + weight * share
        total += sum(brute_force(task, noise, looks, group, steps - 1) for group in after.values())
        best = max(best, total)
    return best


@pytest.mark.parametrize("noise", [0.0, 0.5])
def test_value_with_a_focus_that_moves_is_that_of_brute_force(noise):
    teacher = Teacher(SMALL, FEW, ("position", "focus", "heading"), noise)

    @cache
    def looks(pose, target):
        return pose, hypotheses.thickness_mm(target, pose).tobytes()

    members = {}
    for pose, target in pairs(teacher):
        members.setdefault(looks(pose, target), {})[pose, target] = 1 / len(pairs(teacher))
    expected = sum(brute_force(SMALL, noise, looks, group, 2) for group in members.values())
    assert teacher.best_return == pytest.approx(expected)


@pytest.mark.parametrize("noise", [0.0, 0.5])
def test_value_with_eyes_that_see_less_is_that_of_brute_force(noise):
    def eyes(ideal):
        return replace(ideal, seen=ideal.seen % 3)

    teacher = Teacher(SMALL, FEW, ("position", "focus", "heading"), noise, eyes)
    known, foci = teacher.known, teacher.phantoms.depth_mm
    held = focus_held(SMALL, foci[len(foci) // 2])

    @cache
    def looks(pose, target):
        place = held.indices[replace(pose, focal_depth_mm=held.states[0].focal_depth_mm)]
        column = known.targets.index(replace(target, focal_depth_mm=held.states[0].focal_depth_mm))
        # The object's depth tells who sees it without any doubt.
        depth_mm = target.focal_depth_mm if known.shows[place, column] else None
        return pose, int(known.seen[place, column]), depth_mm

    members = {}
    for pose, target in pairs(teacher):
        members.setdefault(looks(pose, target), {})[pose, target] = 1 / len(pairs(teacher))
    expected = sum(brute_force(SMALL, noise, looks, group, 2) for group in members.values())
    assert teacher.best_return == pytest.approx(expected)
    ideal = Teacher(SMALL, FEW, ("position", "focus", "heading"), noise)
    assert teacher.best_return < ideal.best_return - 1e-3


def test_who_may_see_nothing_does_not_see_the_object_without_doubt():
    ideal = hypotheses.of_distribution(PROBE_PLANE_TRACKED, DRAWN)
    assert 0 < ideal.shows.mean() < 1
    merged = replace(ideal, seen=np.zeros_like(ideal.seen))
    assert not merged.shows.any()


def test_value_is_the_ceiling(teacher):
    assert teacher.best_return == pytest.approx(beliefs.best_return(teacher.known, TRACKED))


def test_its_score_has_the_anchors_of_all_objects(teacher):
    assert teacher.best_score == pytest.approx(teacher.known.anchors.score(teacher.best_return))
    # One place of the object, which whoever is told the pose therefore knows but for its depth, on sight.
    one = Teacher(SMALL, replace(FEW, angle_deg=(0,)), ("position", "focus", "heading"), 0.5)
    assert 0.9 < one.best_score <= 1
    deep = Teacher(SMALL, replace(FEW, angle_deg=(0,), depth_mm=(55,)), ("position", "focus", "heading"), 0.5)
    assert deep.best_score == pytest.approx(1)


def test_episodes_played_by_its_advice_lose_next_to_nothing_of_the_ceiling(teacher):
    """Although it does not count the steps that are left."""
    task = teacher.task
    places, returns = pairs(teacher), np.zeros(len(pairs(teacher)))
    known = teacher.first([info(*place) for place in places])
    assert known.min() >= 0
    for _ in range(task.n_steps):
        costs = teacher.costs(known)
        assert costs.shape == (len(places), 5) and np.all(costs.min(axis=1) == 0)
        actions = costs.argmin(axis=1)
        places = [
            (pose.moved(task.actions[action].move, task.limits), target)
            for (pose, target), action in zip(places, actions, strict=True)
        ]
        known = teacher.following(known, actions, [info(*place) for place in places])
        returns += [task.reward(pose, target, "normalized") for pose, target in places]
    lost = teacher.best_score - teacher.known.anchors.score(returns.mean())
    assert -1e-9 < lost < 5e-3


def test_where_both_turns_look_alike_it_tries_one_and_knows_then(teacher):
    """What the oracle cannot teach: over the object, 30 degrees to either side of its plane look the same."""
    sides = [info(Pose(0, 50, 90), Pose(0, 50, angle)) for angle in (60, 120)]
    known = teacher.first(sides)
    assert known[0] == known[1]
    costs = teacher.costs(known[:1])[0]
    stay, clockwise = 0, 4
    assert costs[stay] > 0 and costs[clockwise] == 0
    turned = [one | {"angle_deg": 105} for one in sides]
    after = teacher.costs(teacher.following(known, np.array([clockwise] * 2), turned))
    assert after.argmin(axis=1).tolist() == [3, clockwise]


def test_rewards_are_the_sum_of_a_part_of_the_probe_and_one_of_the_focus():
    rng = np.random.default_rng(0)
    for task in (EXAMINATION, FOCAL_POINT_RANDOM, PROBE_PLANE_TRACKED):
        held = focus_held(task, 50)
        for k in rng.integers(len(task.states), size=50):
            pose, target = task.states[k], Pose(int(rng.integers(-10, 10)), int(rng.integers(35, 65)), 30)
            own = replace(pose, focal_depth_mm=50), replace(target, focal_depth_mm=50)
            of_focus = task.reward(pose, replace(pose, focal_depth_mm=target.focal_depth_mm), "normalized")
            assert own[0] in held.indices
            expected = held.reward(*own, "normalized") + of_focus * task.moves_focus
            assert task.reward(pose, target, "normalized") == pytest.approx(expected)


def test_depth_is_known_from_when_the_object_was_seen_first():
    teacher = Teacher(SMALL, FEW, ("position", "focus", "heading"))
    up, down = 3, 4
    over, beside = (
        [info(Pose(x, 50, angle), Pose(5, depth, 0)) for depth in FEW.depth_mm]
        for x, angle in ((-10, 0), (-20, 75))
    )
    assert teacher.costs(teacher.first(over)).argmin(axis=1).tolist() == [up, down]
    unseen = teacher.first(beside)
    assert unseen[0] == unseen[1]
    # Who has seen the object remembers its depth where it is not seen any more.
    known = teacher.first(over)
    for angle in range(15, 76, 15):
        over = [one | {"angle_deg": angle} for one in over]
        known = teacher.following(known, np.array([6, 6]), over)
    for x in (-15, -20):
        over = [one | {"x_mm": x} for one in over]
        known = teacher.following(known, np.array([1, 1]), over)
    assert over == beside
    assert known[0] != known[1] and not set(known) & set(unseen)


def test_refuses_episodes_that_begin_where_none_does(teacher):
    with pytest.raises(ValueError, match="episodes must begin where those of the task 'pp-tracked' do"):
        teacher.first([info(Pose(20, 50, 0), Pose(0, 50, 0))])


@pytest.mark.parametrize(
    ("task", "senses", "noise", "words"),
    [
        (PROBE_PLANE_RANDOM, (), 0.25, "with noise, .* needs the senses 'position', 'heading', not none"),
        (PROBE_PLANE_TRACKED, ("heading",), 0.5, "needs the senses 'position', 'heading', not 'heading'"),
        (EXAMINATION, TRACKED, 0.0, "with a focus that moves, a teacher of the task 'exam' needs the senses"),
        (PROBE_PLANE_TRACKED, TRACKED, 2.0, "noise must be"),
    ],
)
def test_refuses_what_leaves_it_in_doubt_about_the_probe(task, senses, noise, words):
    with pytest.raises(ValueError, match=words):
        Teacher(task, ProbePlaneRandomEnv.distribution, senses, noise)
