"""Look-alikes and the map of states, on frames made by hand."""

import numpy as np
import pytest
from matplotlib.colors import to_rgba

from usbench.envs.oracle import policy
from usbench.envs.pose import Pose
from usbench.envs.tasks.focal_point import FOCAL_POINT
from usbench.envs.tasks.probe_plane import PROBE_PLANE
from usbench.figures import look_alikes, state_map, style


def noise_frames(task):
    return np.random.default_rng(0).integers(0, 256, (len(task.states), 9, 4, 1), dtype=np.uint8)


def test_similarity_is_the_correlation_of_pixels():
    first = np.array([[0, 10], [20, 30]], np.uint8)
    found = look_alikes.similarity(
        np.stack([first, 2 * first + 5, 200 - first, [[0, 10], [20, 90]]])[..., None]
    )
    np.testing.assert_allclose(found[0, :3], [1.0, 1.0, -1.0])
    assert found[0, 3] == pytest.approx(np.corrcoef([0, 10, 20, 30], [0, 10, 20, 90])[0, 1])


def test_states_conflict_where_they_share_no_best_action():
    found = look_alikes.conflicts(PROBE_PLANE)
    at = PROBE_PLANE.indices
    assert found[at[Pose(0, 50, 0)], at[Pose(0, 50, 15)]]
    assert not found[at[Pose(0, 50, 0)], at[Pose(0, 50, 180)]]
    # From 90 degrees both ways are as long, so it agrees with either side.
    assert not found[at[Pose(0, 50, 90)], at[Pose(0, 50, 75)]]
    assert not found[at[Pose(0, 50, 90)], at[Pose(0, 50, 105)]]
    assert found[at[Pose(0, 50, 75)], at[Pose(0, 50, 105)]]


def test_the_most_alike_pair_is_the_one_that_was_made_alike():
    frames = noise_frames(FOCAL_POINT)
    above, below = (FOCAL_POINT.indices[Pose(0, z, 0)] for z in (40, 60))
    frames[below] = frames[above]
    same = [FOCAL_POINT.indices[Pose(5, z, 0)] for z in (70, 75)]
    frames[same[1]] = frames[same[0]]  # alike as well, but both go left
    (pair,) = look_alikes.most_alike(FOCAL_POINT, frames, 1).to_dict("records")
    assert pair["correlation"] == pytest.approx(1.0)
    assert (pair["pose"], pair["action"]) == ("x 0 mm, 40 mm deep", "down")
    assert (pair["other"], pair["other_action"]) == ("x 0 mm, 60 mm deep", "up")


@pytest.mark.parametrize(("shade", "color"), [(0, "black"), (1, "white")])
def test_arrows_and_dots_are_legible_on_their_shades(shade, color):
    _, axes = style.panels(1, 1)
    actions = policy(PROBE_PLANE).actions[0]
    state_map.draw(axes[0, 0], PROBE_PLANE, actions, np.full(len(actions), shade), vmin=0, vmax=1)
    _, arrows, dots = axes[0, 0].collections
    for drawn in (arrows, dots):
        assert np.array_equal(np.unique(drawn.get_facecolor(), axis=0), [to_rgba(color)])


@pytest.mark.parametrize("task", [FOCAL_POINT, PROBE_PLANE], ids=lambda task: task.name)
def test_arrows_stand_in_their_states_and_point_where_the_action_goes(task):
    figure, axes = style.panels(1, 1)
    actions = policy(task).actions[0]
    state_map.draw(axes[0, 0], task, actions, np.zeros(len(actions)), vmin=0, vmax=1)
    (arrows,) = [one for one in axes[0, 0].collections if hasattr(one, "U")]
    second = state_map.coordinate(task)
    drawn = dict(
        zip(map(tuple, arrows.XY), zip(np.sign(arrows.U), np.sign(arrows.V), strict=True), strict=True)
    )
    assert len(drawn) == (actions != 0).sum()
    for pose, action in zip(task.states, actions, strict=True):
        if action:
            move = task.actions[action].move
            expected = np.sign(move.x_mm), np.sign(getattr(move, second))
            assert drawn[pose.x_mm, getattr(pose, second)] == expected
    assert axes[0, 0].get_xlabel() == "position of the probe (mm)"


def test_the_figure_has_a_panel_for_each_task():
    figure = look_alikes.draw({task: noise_frames(task) for task in (FOCAL_POINT, PROBE_PLANE)})
    assert [axis.get_title() for axis in figure.axes][:2] == ["Focal point", "Probe plane"]
