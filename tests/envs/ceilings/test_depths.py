"""Columns of a focus with what is known of the object's depth."""

import numpy as np
import pytest

from usbench.envs.ceilings.depths import Depths, focus_held
from usbench.envs.tasks.examination import EXAMINATION
from usbench.envs.tasks.phantom_distribution import PhantomDistribution
from usbench.envs.tasks.probe_plane import PROBE_PLANE

DRAWN = PhantomDistribution((0,), (35, 50, 65), (0,))
DEPTHS = Depths.of(EXAMINATION, DRAWN)
DOWN = [action.name for action in EXAMINATION.actions].index("down")


@pytest.mark.parametrize("depth_mm", DRAWN.depth_mm)
def test_a_column_is_a_focus_and_a_depth(depth_mm):
    for focus_mm in range(5, 91, 5):
        column = DEPTHS.column(focus_mm, depth_mm)
        assert DEPTHS.rewards[column] == pytest.approx(-abs(focus_mm - depth_mm) / 50)
        assert DEPTHS.following[DOWN, column] == DEPTHS.column(min(focus_mm + 5, 90), depth_mm)


def test_of_an_object_that_was_never_seen_every_depth_is_as_likely():
    column = DEPTHS.column(50, None)
    assert DEPTHS.n_known <= column < DEPTHS.n_columns
    assert DEPTHS.rewards[column] == pytest.approx(-2 * 15 / 50 / 3)
    assert DEPTHS.following[DOWN, column] == DEPTHS.column(55, None)


def test_depths_do_not_matter_where_the_focus_stays():
    depths = Depths.of(PROBE_PLANE, DRAWN)
    assert depths.n_depths == 1 and depths.column(50, 35) == depths.column(50, 65)
    np.testing.assert_array_equal(depths.rewards, 0)


def test_a_held_focus_leaves_position_and_angle():
    held = focus_held(EXAMINATION, 50)
    assert {pose.focal_depth_mm for pose in held.states} == {50}
    assert len(held.states) * 18 == len(EXAMINATION.states)
    assert held.starts[0].moved(held.actions[DOWN].move, held.limits) == held.starts[0]
