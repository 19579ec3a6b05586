"""Ceilings against brute force, against the oracle, and what limits them against real frames."""

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

from usbench.envs.bmode import DEFAULT_IMAGING
from usbench.envs.ceilings import beliefs, eyes, hypotheses, memoryless
from usbench.envs.frames import frame_store
from usbench.envs.phantom import ObjectOfInterest, Phantom
from usbench.envs.pose import Pose
from usbench.envs.probe import DEFAULT_ARRAY
from usbench.envs.tasks.examination import EXAMINATION
from usbench.envs.tasks.phantom_distribution import PhantomDistribution
from usbench.envs.tasks.random_phantoms import PROBE_PLANE_RANDOM

# Two places of the object and two planes, few poses, three steps: small enough for brute force.
STATES = tuple(Pose(x, 50, angle) for x in (-20, -15, -10) for angle in range(0, 360, 15))
SMALL = replace(PROBE_PLANE_RANDOM, starts=STATES[::5], n_steps=3)
FEW = PhantomDistribution((-10,), (50,), (0, 45))


@pytest.fixture(scope="module")
def small():
    return hypotheses.of_distribution(SMALL, FEW)


@pytest.fixture(scope="module")
def whole():
    return hypotheses.of_distribution(
        PROBE_PLANE_RANDOM, PhantomDistribution((-10, 0), (50,), tuple(range(0, 180, 30)))
    )


def brute_force(known, observed, members, steps):
    """Sum over the members of the best return of any policy that remembers all, by trying every action."""
    if steps == 0:
        return 0.0
    best = -np.inf
    for action in range(len(known.task.actions)):
        after = [int(known.following[h, action]) for h in members]
        total = sum(known.rewards[h] for h in after)
        for seen in {int(observed[h]) for h in after}:
            total += brute_force(known, observed, [h for h in after if observed[h] == seen], steps - 1)
        best = max(best, total)
    return best


@pytest.mark.parametrize("senses", [(), ("heading",), ("position", "heading")])
def test_the_best_policy_with_memory_is_that_of_brute_force(small, senses):
    observed = small.observed(senses)
    groups = [
        [h for h in small.starts if observed[h] == seen] for seen in set(observed[small.starts].tolist())
    ]
    expected = sum(brute_force(small, observed, group, 3) for group in groups) / len(small.starts)
    assert beliefs.best_return(small, senses) == pytest.approx(expected)


def test_who_sees_all_scores_one_and_who_sees_nothing_does_as_blind_plans_do(small):
    n = small.seen.size
    all_seen = hypotheses.Hypotheses(small.task, small.targets, np.arange(n).reshape(small.seen.shape))
    assert all_seen.anchors.score(beliefs.best_return(all_seen, ())) == pytest.approx(1)
    found = memoryless.found_return(memoryless.histories(all_seen, ()), 3, np.random.default_rng(0))
    assert all_seen.anchors.score(found) == pytest.approx(1, abs=2e-3)

    blind = hypotheses.Hypotheses(small.task, small.targets, np.zeros_like(small.seen))
    plans = []
    for plan in itertools.product(range(5), repeat=3):
        at, total = blind.starts, 0.0
        for action in plan:
            at = blind.following[at, action]
            total += blind.rewards[at].mean()
        plans.append(total)
    assert beliefs.best_return(blind, ()) == pytest.approx(max(plans))


def test_more_knowledge_is_never_worse_and_memory_bounds_what_has_none(whole):
    def best(*senses):
        return beliefs.best_return(whole, senses)

    assert best() < best("heading") < best("position", "heading")
    for senses, n_frames in (((), 1), (("heading",), 1), ((), 2)):
        past = memoryless.histories(whole, senses, n_frames, with_actions=n_frames > 1)
        found = memoryless.found_return(past, whole.task.n_steps, np.random.default_rng(0), 60)
        assert whole.anchors.random < found <= beliefs.best_return(whole, senses) + 1e-9


def test_one_frame_may_come_with_the_action_before_it_and_nothing_else(small):
    blind = hypotheses.Hypotheses(small.task, small.targets, np.zeros_like(small.seen))
    past = memoryless.histories(blind, (), 1, with_actions=True)
    told = past.observed[past.following]
    assert len(set(past.observed[past.starts])) == 1
    assert [len(set(of_action)) for of_action in told.T] == [1] * 5
    assert len({*told[0], past.observed[past.starts[0]]}) == 6


@pytest.mark.parametrize("n_frames", [1, 2])
def test_the_gradients_return_is_that_of_a_played_policy(small, n_frames):
    past = memoryless.histories(small, (), n_frames, with_actions=True)
    rng = np.random.default_rng(0)
    policy = rng.dirichlet(np.ones(5), int(past.observed.max()) + 1)
    expected, _ = memoryless._evaluated(past, 3, policy)
    totals = []
    for start in rng.choice(past.starts, 4000):
        at, total = start, 0.0
        for _ in range(3):
            at = past.following[at, rng.choice(5, p=policy[past.observed[at]])]
            total += past.rewards[at]
        totals.append(total)
    assert np.mean(totals) == pytest.approx(expected, abs=4 * np.std(totals) / np.sqrt(len(totals)))


@pytest.mark.parametrize(("dx", "object_deg", "probe_deg"), [(0, 30, 75), (5, 45, 120), (-10, 15, 300)])
def test_ideal_eyes_have_the_objects_and_the_beams_symmetries(dx, object_deg, probe_deg):
    def seen(x, a_o, a_p):
        return hypotheses.thickness_mm(Pose(x, 50, a_o), Pose(0, 50, a_p))

    here = seen(dx, object_deg, probe_deg)
    assert here.any()
    for other in (
        (dx, -object_deg, -probe_deg),
        (-dx, object_deg, probe_deg + 180),
        (-dx, -object_deg, 180 - probe_deg),
    ):
        np.testing.assert_array_equal(here, seen(*other))
    mirrored = here.reshape(90, 40)[:, ::-1].ravel()
    np.testing.assert_array_equal(mirrored, seen(dx, object_deg, probe_deg + 180))
    assert (np.abs(here - seen(dx, object_deg, probe_deg + 30)) > 1).sum() > 30


def test_real_frames_have_the_symmetries_but_for_speckle():
    """A frame of other speckle is as much alike from a symmetric pose as from the same."""

    def frame(seed, dx, a_o, a_p):
        phantom = Phantom(seed=seed, object_of_interest=ObjectOfInterest(dx, 50, a_o))
        return frame_store(phantom, DEFAULT_ARRAY, DEFAULT_IMAGING).frame(Pose(0, 50, a_p)).astype(float)

    def correlation(one, other):
        return np.corrcoef(one.ravel(), other.ravel())[0, 1]

    same, symmetric, elsewhere = [], [], []
    for dx, a_o, a_p in ((0, 30, 60), (5, 45, 75), (5, 0, 345)):
        here = frame(1, dx, a_o, a_p)
        same.append(correlation(here, frame(2, dx, a_o, a_p)))
        symmetric += [
            correlation(here, frame(3, dx, -a_o, -a_p)),
            correlation(here, frame(4, -dx, a_o, a_p + 180)),
            correlation(here, frame(5, -dx, -a_o, 180 - a_p)),
            correlation(here[:, ::-1], frame(6, dx, a_o, a_p + 180)),
        ]
        elsewhere += [
            correlation(here, frame(7, dx, a_o, a_p + 60)),
            correlation(here, frame(8, dx, a_o, a_p - 60)),
        ]
    assert np.median(symmetric) == pytest.approx(np.median(same), abs=0.03)
    assert np.median(elsewhere) < np.median(same) - 0.1


def test_poses_whose_frames_lie_near_each_other_share_a_group():
    means = np.array([[0.0, 0.0], [0.5, 0.0], [5.0, 0.0], [5.2, 0.0], [0.1, 0.0]])
    trusted = np.array([True, True, True, True, False])
    assert eyes._groups(means, trusted, 1.0).tolist() == [0, 0, 1, 1, 2]


@dataclass
class DrawnStore:
    """Stands in for a phantom's frames: blocks of each relation of probe and object, and noise."""

    known: hypotheses.Hypotheses
    column: int
    pattern_of: Callable[[int], int]
    noise: np.random.Generator

    def frame(self, pose):
        relation = int(self.known.seen[self.known.task.states.index(pose), self.column])
        blocks = np.random.default_rng(self.pattern_of(relation)).integers(60, 180, (18, 8))
        return (np.kron(blocks, np.ones((5, 5))) + self.noise.normal(0, 20, (90, 40))).astype(np.uint8)


@pytest.mark.parametrize("n_patterns", [1, 2, None])
def test_real_eyes_tell_apart_the_relations_whose_frames_differ(small, n_patterns):
    noise, columns = np.random.default_rng(0), [0, 1] * 4
    phantoms = [
        Phantom(object_of_interest=ObjectOfInterest(place.x_mm, 50, place.angle_deg))
        for place in (small.targets[column] for column in columns)
    ]
    stores = [
        DrawnStore(small, column, lambda relation: relation % n_patterns if n_patterns else relation, noise)
        for column in columns
    ]
    # So small a probability that the noise in the mean of four frames tells nothing apart.
    seen = eyes.seen_by_real_eyes(small, phantoms, stores, error=1e-9).seen
    expected = small.seen % n_patterns if n_patterns else small.seen
    pairs = {(int(a), int(b)) for a, b in zip(seen.ravel(), expected.ravel(), strict=True)}
    assert len(pairs) == len(np.unique(seen)) == len(np.unique(expected)) >= (n_patterns or 3)


def test_features_are_those_around_the_object_whatever_gain_and_depth():
    frame = np.random.default_rng(0).integers(40, 120, (90, 40)).astype(np.uint8)
    deeper = np.roll(frame, 10, axis=0)
    np.testing.assert_allclose(eyes.features(frame, 45), eyes.features(deeper, 55))
    np.testing.assert_allclose(eyes.features(frame, 45), eyes.features(frame * 2, 45))


def test_a_task_that_moves_the_focus_is_refused():
    with pytest.raises(ValueError, match="the task 'exam' moves the focus, which ideal eyes do not see"):
        hypotheses.of_distribution(EXAMINATION, FEW)


def test_places_that_are_not_equally_probable_are_refused():
    hypotheses.of_distribution(SMALL, PhantomDistribution((0,), (50,), (0, 180, 90, 270)))
    with pytest.raises(ValueError, match=r"equally probable, not x_mm .0,. and angle_deg .0, 180, 90."):
        hypotheses.of_distribution(SMALL, PhantomDistribution((0,), (50,), (0, 180, 90)))
