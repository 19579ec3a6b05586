"""What a classical agent knows of its task, against the task itself."""

import numpy as np
import pytest

from usbench.envs import oracle
from usbench.envs.ceilings.scene_model import SceneModel
from usbench.envs.pose import Pose
from usbench.envs.tasks.examination import EXAMINATION
from usbench.envs.tasks.phantom_distribution import PhantomDistribution
from usbench.envs.tasks.random_phantoms import PROBE_PLANE_TRACKED, ProbePlaneTrackedEnv

TRACKED = ("position", "heading")
DRAWN = PhantomDistribution((-10, 0), (45, 50), tuple(range(0, 180, 30)))


@pytest.fixture(scope="module")
def model():
    return SceneModel(PROBE_PLANE_TRACKED, DRAWN, (*TRACKED, "actions"))


def test_senses_tell_every_pose_whatever_the_last_action(model):
    told = np.stack([model._senses.values(pose, k % 5) for k, pose in enumerate(model.task.states)])
    stacked = np.concatenate([np.zeros_like(told), told], axis=1)
    assert model.states(stacked).tolist() == list(range(len(model.task.states)))


def test_poses_that_share_a_frame_share_a_look(model):
    def look(pose, target):
        coordinates = ("x_mm", "focal_depth_mm", "angle_deg")
        there = {name: getattr(pose, name) for name in coordinates}
        return int(model.look([there | {f"target_{name}": getattr(target, name) for name in coordinates}])[0])

    here = look(Pose(5, 50, 90), Pose(0, 45, 30))
    assert here == look(Pose(5, 50, 270 - 0 - 180), Pose(0, 50, 210))
    assert here == look(Pose(5, 50, -90), Pose(0, 45, -30))
    assert here != look(Pose(5, 50, 90), Pose(0, 45, 60))
    assert 0 <= here < model.n_looks


def test_best_actions_are_the_oracles(model):
    places = sorted((x, angle) for x in DRAWN.x_mm for angle in DRAWN.angle_deg)
    assert model.is_best.shape == (216, len(places), 5)
    policy = oracle.policy(model.task, target=Pose(-10, 50, 60))
    place = model._known.places[-10, 60]
    np.testing.assert_array_equal(model.is_best[:, place], policy.costs[0] == 0)


@pytest.mark.parametrize(
    ("task", "senses", "words"),
    [
        (EXAMINATION, ("position", "focus", "heading"), "which the task 'exam' moves"),
        (PROBE_PLANE_TRACKED, ("heading",), "needs the senses 'position', 'heading', not 'heading'"),
        (PROBE_PLANE_TRACKED, (), "needs the senses 'position', 'heading', not none"),
    ],
)
def test_refuses_tasks_whose_pose_is_not_told(task, senses, words):
    with pytest.raises(ValueError, match=words):
        SceneModel(task, ProbePlaneTrackedEnv.distribution, senses)
