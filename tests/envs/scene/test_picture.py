"""The picture: fixed size, shows what moves where it is, hides the object on request, and is quick."""

import time

import gymnasium as gym
import numpy as np
import pytest

from usbench.envs.anatomy import Recording
from usbench.envs.bmode import Imaging
from usbench.envs.phantom import ObjectOfInterest, Phantom
from usbench.envs.pose import Pose
from usbench.envs.probe import LinearArray
from usbench.envs.scene.drawing import BODY, FOCUS, LIMB
from usbench.envs.scene.picture import ABOVE_LEFT, FRAME_LEFT, HEIGHT, SIDE_LEFT, TOP, draw_scene, panels
from usbench.envs.tasks.probe_plane import ProbePlaneEnv

PHANTOM = Phantom()
BLACK = np.zeros((90, 40), np.uint8)


def colored(image, color, tolerance=25):
    return np.abs(image.astype(int) - color).max(axis=2) <= tolerance


def test_the_picture_has_a_fixed_even_size():
    for pose in (Pose(-20, 5, 0), Pose(20, 90, 90), Pose(0, 50, 195)):
        image = draw_scene(PHANTOM, pose, BLACK)
        assert image.shape == (HEIGHT, 1240, 3) == (580, 1240, 3)
        assert image.dtype == np.uint8 and image.flags.writeable


@pytest.mark.parametrize("pose", [Pose(-20, 10, 0), Pose(15, 50, 60), Pose(0, 85, 90)])
def test_the_focal_point_is_marked_in_every_view(pose):
    image = draw_scene(PHANTOM, pose, BLACK)
    x, depth = (40 + pose.x_mm) * 5, pose.focal_depth_mm * 5
    assert colored(image, FOCUS)[TOP + 200, ABOVE_LEFT + x]
    assert colored(image, FOCUS)[TOP + depth, SIDE_LEFT + x]
    right = FRAME_LEFT + 200
    rows = np.flatnonzero(colored(image, FOCUS)[:, right + 5 : right + 18].any(axis=1))
    assert np.mean(rows) == pytest.approx(TOP + depth, abs=1)


@pytest.mark.parametrize(
    ("imaging", "height", "width"),
    [
        (Imaging(height_px=128, width_px=128), 450, 450),
        (Imaging(height_px=64, width_px=64), 450, 450),
        (Imaging(height_px=180, width_px=80, pixel_size=0.5e-3), 450, 200),
        (Imaging(height_px=40, width_px=200), 120, 600),
        (Imaging(height_px=7, width_px=3), 450, 192),
        (Imaging(height_px=1, width_px=2000, pixel_size=0.25e-3, median_size=1), 1, 600),
    ],
)
def test_a_frame_of_any_size_is_shown_to_scale(imaging, height, width):
    frame = np.full((imaging.height_px, imaging.width_px), 255, np.uint8)
    for focal_depth_mm in (5, 50, 90):  # below the image, too
        pose = Pose(0, focal_depth_mm, 0)
        image = draw_scene(PHANTOM, pose, frame, imaging=imaging)
        assert image.shape == (580, FRAME_LEFT + width + 40, 3) and image.shape[1] % 2 == 0
        assert np.all(image[TOP : TOP + height, FRAME_LEFT : FRAME_LEFT + width] == 255)
        assert panels(image.shape[1])["B-mode frame"] == (FRAME_LEFT, width)
        marked = colored(image, FOCUS)[:, FRAME_LEFT + width :]
        assert marked.any() == (focal_depth_mm <= 1e3 * imaging.depth)


@pytest.mark.parametrize(("n_lines", "n_active", "slice_thickness"), [(96, 32, 10e-3), (32, 64, 4e-3)])
def test_the_probe_is_drawn_as_wide_as_it_is(n_lines, n_active, slice_thickness):
    array = LinearArray(n_lines=n_lines, n_active=n_active, slice_thickness=slice_thickness)
    hidden = {"show_object": False}
    turned = draw_scene(PHANTOM, Pose(0, 50, 90), BLACK, array, **hidden)
    straight = draw_scene(PHANTOM, Pose(), BLACK, array, **hidden)
    changed = np.any(turned != straight, axis=2)[TOP : TOP + 400, ABOVE_LEFT : ABOVE_LEFT + 400]
    rows, columns = np.nonzero(changed)
    assert np.ptp(rows) / 5 == pytest.approx(0.625 * n_lines, abs=1)
    assert np.ptp(columns) / 5 == pytest.approx(0.625 * n_lines, abs=1)


def test_a_phantom_shallower_than_the_focus_is_drawn():
    small = Phantom(
        width_mm=40, height_mm=40, depth_mm=45, object_of_interest=ObjectOfInterest(depth_mm=22, scale=0.5)
    )
    assert draw_scene(small, Pose(0, 90, 0), BLACK).shape == (580, 1240, 3)


def test_the_frame_is_shown_in_its_place():
    frame = BLACK.copy()
    frame[60:70, 10:20] = 255
    image = draw_scene(PHANTOM, Pose(), frame)
    panel = image[TOP : TOP + 450, FRAME_LEFT : FRAME_LEFT + 200]
    assert np.all(panel[305:345, 55:95] == 255)
    assert np.all(panel[:290] == 0) and np.all(panel[:, 110:] == 0)


def test_the_plane_turns_clockwise_seen_from_above():
    difference = np.any(
        draw_scene(PHANTOM, Pose(0, 50, 45), BLACK, show_object=False)
        != draw_scene(PHANTOM, Pose(0, 50, 135), BLACK, show_object=False),
        axis=2,
    )
    turned = draw_scene(PHANTOM, Pose(0, 50, 45), BLACK, show_object=False)
    middle_row, middle_column, reach = TOP + 200, ABOVE_LEFT + 200, 60
    lower_right = turned[middle_row + reach, middle_column + reach].astype(int)
    upper_right = turned[middle_row - reach, middle_column + reach].astype(int)
    assert lower_right.max() > upper_right.max() + 60  # x turned towards y, and y points down
    assert difference[middle_row + reach, middle_column + reach]


def test_the_object_is_drawn_where_it_is_and_can_be_hidden():
    shown = draw_scene(PHANTOM, Pose(-20, 50, 90), BLACK)
    hidden = draw_scene(PHANTOM, Pose(-20, 50, 90), BLACK, show_object=False)
    # The body's middle from the side (0, 50) mm; the head's from above (0, 0) and from the side (0, 33.2).
    for row, column, color in (
        (TOP + 250, SIDE_LEFT + 200, BODY),
        (TOP + 200, ABOVE_LEFT + 200, LIMB),
        (TOP + 166, SIDE_LEFT + 200, LIMB),
    ):
        assert colored(shown, color, 60)[row, column]
        assert not colored(hidden, color, 60)[row, column]


def test_a_hidden_object_leaves_no_trace():
    elsewhere = Phantom(object_of_interest=ObjectOfInterest(x_mm=-15, depth_mm=30, angle_deg=45, scale=0.6))
    hidden = [draw_scene(phantom, Pose(5), BLACK, show_object=False) for phantom in (PHANTOM, elsewhere)]
    np.testing.assert_array_equal(*hidden)


@pytest.mark.parametrize(
    ("angle_deg", "above", "aside"),
    # In mm: x and y of the target's image plane from above, x from the side.
    [(0, [-10, 30, 0, 0], [-10, 30]), (90, [10, 10, -20, 20], [10, 10]), (60, [0, 20, -17.3, 17.3], [0, 20])],
)
def test_of_an_anatomy_of_ones_own_the_targets_plane_is_shown_alone(angle_deg, above, aside):
    # No file is needed for it.
    anatomy = Recording(path="", digest="", target=Pose(10, 50, angle_deg))
    shown, hidden = (draw_scene(anatomy, Pose(-20), BLACK, show_object=show) for show in (True, False))
    np.testing.assert_array_equal(hidden, draw_scene(PHANTOM, Pose(-20), BLACK, show_object=False))
    rows, columns = np.nonzero(np.any(shown != hidden, axis=2))
    left = columns < SIDE_LEFT - 20
    x, y = (columns[left] - ABOVE_LEFT) / 5 - 40, (rows[left] - TOP) / 5 - 40
    np.testing.assert_allclose([x.min(), x.max(), y.min(), y.max()], above, atol=1)
    x, z = (columns[~left] - SIDE_LEFT) / 5 - 40, (rows[~left] - TOP) / 5
    np.testing.assert_allclose([x.min(), x.max(), z.min(), z.max()], [*aside, 0, 90], atol=1)


def test_a_caption_is_written():
    plain = draw_scene(PHANTOM, Pose(), BLACK)
    written = draw_scene(PHANTOM, Pose(), BLACK, caption="step 3: rotate clockwise")
    rows, columns = np.nonzero(np.any(plain != written, axis=2))
    assert rows.min() > TOP + 400 and columns.max() < SIDE_LEFT


def test_pictures_are_independent_of_each_other():
    first = draw_scene(PHANTOM, Pose(5, 30, 15), BLACK)
    kept = first.copy()
    first[...] = 0
    np.testing.assert_array_equal(draw_scene(PHANTOM, Pose(5, 30, 15), BLACK), kept)


def test_a_frame_of_another_shape_is_refused():
    with pytest.raises(ValueError, match=r"frame must be \(90, 40\) uint8, not \(90, 40, 1\) uint8"):
        draw_scene(PHANTOM, Pose(), BLACK[:, :, np.newaxis])


def test_a_picture_takes_less_than_15_ms():
    draw_scene(PHANTOM, Pose(), BLACK)
    times = []
    for angle in range(0, 300, 15):
        start = time.perf_counter()
        draw_scene(PHANTOM, Pose(0, 50, angle), BLACK, caption="step 1")
        times.append(time.perf_counter() - start)
    assert min(times) < 0.015


def test_render_draws_the_current_pose(monkeypatch):
    class BlackFrames:
        def frame(self, pose):
            return BLACK

    monkeypatch.setattr("usbench.envs.guidance.frame_store", lambda *_: BlackFrames())
    env = ProbePlaneEnv(render_mode="rgb_array")
    env.reset(options={"x_mm": 5, "angle_deg": 60})
    np.testing.assert_array_equal(env.render(), draw_scene(PHANTOM, Pose(5, 50, 60), BLACK))
    silent = ProbePlaneEnv()
    silent.reset()
    with pytest.warns(UserWarning, match="render_mode='rgb_array'"):
        assert silent.render() is None
    with pytest.raises(gym.error.ResetNeeded):
        ProbePlaneEnv(render_mode="rgb_array").render()
