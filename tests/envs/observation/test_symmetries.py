"""The exact symmetries of tasks: laws of a group, and real environments that do what the symmetries say."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from symmetric import viewed
from volumes import block

from usbench.envs.observation.senses import available, checked
from usbench.envs.observation.symmetries import _ALL, symmetries
from usbench.envs.observation.wrappers import ImageStack
from usbench.envs.phantom import ObjectOfInterest, Phantom
from usbench.envs.pose import Pose
from usbench.envs.tasks.phantom_distribution import PhantomDistribution
from usbench.setting import Setting
from usbench.setting_parts import anatomy_record
from usbench.suite import TASKS
from usbench.trials import knowledge

SENSES = ("position", "heading", "actions")
EVEN = PhantomDistribution(x_mm=(-5, 0, 5), depth_mm=(50,), angle_deg=(0, 45, 90, 135))
GENERATOR = np.random.default_rng(0)


def found(task):
    guidance = TASKS[task].guidance
    return symmetries(checked(available(guidance), guidance), EVEN)


def random_observation(one, n_frames=2):
    senses = GENERATOR.normal(size=n_frames * one.sources.shape[1]).astype(np.float32)
    return {"image": GENERATOR.integers(0, 256, (9, 4, n_frames)), "senses": senses}


@pytest.mark.parametrize("task", ["pp-tracked", "exam-tracked", "fp-random", "exam-stop"])
def test_symmetries_are_a_group_in_which_each_undoes_itself(task):
    known = found(task)
    observation = random_observation(known)
    seen = [viewed(known, k, observation) for k in range(len(known))]
    np.testing.assert_equal(seen[0], observation)
    assert known.actions[0].tolist() == list(range(known.actions.shape[1]))
    for first in range(len(known)):
        for second in range(len(known)):
            both = viewed(known, second, seen[first])
            same = [k for k in range(len(known)) if np.array_equal(seen[k]["senses"], both["senses"])]
            same = [k for k in same if np.array_equal(seen[k]["image"], both["image"])]
            assert len(same) == 1
            np.testing.assert_array_equal(known.actions[same[0]], known.actions[second][known.actions[first]])
            assert (same[0] == 0) == (first == second)


def test_a_probe_that_never_turns_has_one_symmetry_and_one_that_turns_has_seven():
    assert (len(found("fp-random")), len(found("pp-random")), len(found("exam-tracked"))) == (2, 8, 8)
    # Mirrored, and left and right swapped.
    assert found("fp-random").mirrored.tolist() == [False, True]
    assert found("fp-random").actions[1].tolist() == [0, 2, 1, 3, 4]


def test_coordinates_are_what_is_told_of_the_pose_and_actions_are_not():
    # x, focus, sine and cosine; then one place for each of the seven actions.
    assert found("exam-tracked").coordinates.tolist() == [True] * 4 + [False] * 7
    assert not symmetries(checked(("actions",), TASKS["pp-random"].guidance), EVEN).coordinates.any()
    assert symmetries(checked(("position",), TASKS["pp-random"].guidance), EVEN).coordinates.all()


def test_the_action_that_ends_an_episode_stays():
    assert (found("exam-stop").actions[:, -1] == found("exam-stop").actions.shape[1] - 1).all()


def test_symmetries_for_which_an_action_or_a_slip_is_missing_are_left_out():
    task = TASKS["fp-random"].guidance
    assert len(symmetries(checked((), task), EVEN)) == 2
    (right,) = (action for action in task.actions if action.move.x_mm > 0)
    for changes in (
        {"actions": tuple(action for action in task.actions if action != right)},
        {"displacements": (right.move,)},
        # Both ways, but one of them more often.
        {"displacements": (*task.displacements, right.move)},
    ):
        assert len(symmetries(checked((), replace(task, **changes)), EVEN)) == 1


@pytest.mark.parametrize(
    ("uneven", "left"),
    [
        # The probe turned about; elevation reflected, which negates angles, and both.
        ({"x_mm": (0, 5)}, 4),
        ({"x_mm": (-5, 0, 0, 5, 5)}, 4),
        ({"angle_deg": (15, 30)}, 4),
        ({"angle_deg": (0, 30, 150, 330)}, 4),
        ({"x_mm": (0, 5), "angle_deg": (15, 30)}, 2),
        # Turned about, an object is the same.
        ({"angle_deg": (30, 330)}, 8),
    ],
)
def test_symmetries_that_move_objects_where_none_are_drawn_are_left_out(uneven, left):
    task = TASKS["pp-tracked"].guidance
    assert len(symmetries(checked(("position", "heading"), task), replace(EVEN, **uneven))) == left


def test_custom_anatomy_has_no_symmetry(tmp_path):
    block(tmp_path / "block.mha")
    anatomy = anatomy_record.read(tmp_path / "block.mha", {"target_x_mm": 10, "target_angle_deg": 30})
    known = knowledge.symmetries(Setting(task="pp", anatomy=anatomy))
    assert len(known) == 1
    assert known.actions.tolist() == [[0, 1, 2, 3, 4]] and known.mirrored.tolist() == [False]


def play(target, start, actions, seed):
    """Return observations (stacks of two) and rewards of an episode in an object at `target`."""
    phantom = Phantom(
        seed=seed, object_of_interest=ObjectOfInterest(target.x_mm, 50, target.angle_deg, contrast=20.0)
    )
    env = ImageStack(gym.make("usbench/ProbePlane-v0", phantom=phantom, senses=SENSES), 2)
    seen, _ = env.reset(seed=0, options={"x_mm": start.x_mm, "angle_deg": start.angle_deg})
    steps = [(seen, None), *((step[0], step[1]) for step in map(env.step, actions))]
    return [list(column) for column in zip(*steps, strict=True)]


@pytest.mark.parametrize("task", [name for name, row in TASKS.items() if not row.phantoms])
def test_a_task_whose_phantom_stays_the_same_has_no_symmetry(task):
    """An agent may know its phantom by the speckle, which tells poses apart that would be alike otherwise."""
    known = knowledge.symmetries(Setting(task=task))
    assert known.mirrored.tolist() == [False]
    assert known.actions.tolist() == [list(range(len(TASKS[task].guidance.actions)))]


@pytest.mark.parametrize("number", range(8))
def test_symmetric_scenes_tell_and_earn_the_same_but_for_speckle(number):
    """Frames of another phantom are as much alike as the symmetry is exact; senses and rewards are equal."""
    known, change = knowledge.symmetries(Setting(task="pp-random", senses=SENSES)), _ALL[number]
    target, start, actions = Pose(5, 50, 30), Pose(10, 50, 75), [1, 3, 4, 4, 2, 0]
    of_object = Pose(change.x * target.x_mm, 50, change.angle * target.angle_deg)
    images, rewards = play(target, start, actions, seed=1)
    others, earned = play(of_object, change.pose(start), known.actions[number][actions].tolist(), seed=2)
    assert rewards == earned
    alike = []
    for image, other in zip(images, others, strict=True):
        seen = viewed(known, number, image)
        np.testing.assert_array_equal(seen["senses"], other["senses"])
        alike.append(np.corrcoef(seen["image"].ravel(), other["image"].ravel())[0, 1])
    # The same pose in other speckle has 0.98 and more, the first one mirrored wrongly 0.89.
    assert min(alike) > 0.97
