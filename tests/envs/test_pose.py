"""The grid of poses: limits, wrap, no drift, and how tissue is seen from the probe."""

import math

import numpy as np
import pytest

from usbench.envs.pose import Limits, Move, Pose, cos_deg, sin_deg


def test_a_move_changes_each_coordinate_by_itself():
    assert Pose(0, 50, 0).moved(Move(5, -5, 15)) == Pose(5, 45, 15)
    assert Pose(20, 50, 0).moved(Move(x_mm=5, focal_depth_mm=5)) == Pose(20, 55, 0)
    assert Pose(0, 90, 0).moved(Move(x_mm=-5, focal_depth_mm=5)) == Pose(-5, 90, 0)


@pytest.mark.parametrize(
    ("pose", "move"),
    [
        (Pose(20), Move(x_mm=5)),
        (Pose(-20), Move(x_mm=-5)),
        (Pose(15), Move(x_mm=10)),
        (Pose(0, 5), Move(focal_depth_mm=-5)),
        (Pose(0, 90), Move(focal_depth_mm=5)),
    ],
)
def test_a_blocked_move_changes_nothing(pose, move):
    assert pose.moved(move) == pose


def test_limits_are_reached_and_can_be_chosen():
    assert Pose(15).moved(Move(x_mm=5)).x_mm == 20
    assert Pose(0, 10).moved(Move(focal_depth_mm=-5)).focal_depth_mm == 5
    assert Pose(20).moved(Move(x_mm=5), Limits(x_mm=(-40, 40))).x_mm == 25
    with pytest.raises(ValueError, match=r"x_mm must be in \[-20, 20\], not 25"):
        Limits().check(Pose(25))


def test_angles_are_held_modulo_360():
    assert Pose(angle_deg=345).moved(Move(angle_deg=15)) == Pose(angle_deg=0)
    assert Pose(angle_deg=0).moved(Move(angle_deg=-15)).angle_deg == 345
    assert Pose(angle_deg=-90) == Pose(angle_deg=270)


def test_ten_thousand_moves_there_and_back_leave_no_drift():
    pose = start = Pose(-15, 10, 45)
    there, back = Move(5, 5, 15), Move(-5, -5, -15)
    for move in [there] * 4 + [back] * 4:
        pose = pose.moved(move)
    assert pose == start
    for step in range(10_000):
        pose = pose.moved(there if step % 2 == 0 else back)
    assert pose == start
    for _ in range(10_000):
        pose = pose.moved(Move(angle_deg=15))
    assert pose.angle_deg == (45 + 150_000) % 360


def test_whole_numbers_of_other_types_are_the_same_pose():
    pose = Pose(np.int64(5), 50.0, np.int32(15))
    assert pose == Pose(5, 50, 15)
    assert hash(pose) == hash(Pose(5, 50, 15))
    assert [type(value) for value in (pose.x_mm, pose.focal_depth_mm, pose.angle_deg)] == [int, int, int]


@pytest.mark.parametrize("value", [2.5, math.nan, math.inf])
def test_a_fraction_is_refused(value):
    with pytest.raises(ValueError, match="x_mm must be a whole number"):
        Pose(x_mm=value)


@pytest.mark.parametrize("value", ["5", None, True, 1j])
def test_what_is_not_a_number_is_refused(value):
    with pytest.raises(TypeError, match="angle_deg must be a whole number"):
        Move(angle_deg=value)


def test_a_focus_above_the_skin_is_refused():
    with pytest.raises(ValueError, match="focal_depth_mm must be at least 1, not 0"):
        Pose(focal_depth_mm=0)


def test_reversed_limits_are_refused():
    with pytest.raises(ValueError, match="low, high"):
        Limits(x_mm=(20, -20))


def test_sine_and_cosine_are_exact_where_the_object_is_symmetric():
    assert [sin_deg(angle) for angle in (0, 90, 180, 270, 360)] == [0, 1, 0, -1, 0]
    assert [cos_deg(angle) for angle in (0, 90, 180, 270, 360)] == [1, 0, -1, 0, 1]
    for angle in range(-720, 720, 15):
        assert sin_deg(angle) == pytest.approx(math.sin(math.radians(angle)), abs=1e-12)
        assert sin_deg(angle + 180) == -sin_deg(angle)
        assert sin_deg(180 - angle) == sin_deg(angle)


def test_tissue_is_seen_from_the_probes_own_centre():
    points = np.array([[5.0, 0.0, 50.0], [5.0, 7.0, 30.0]]) * 1e-3
    np.testing.assert_allclose(Pose(5).to_probe(points) * 1e3, [[0, 0, 50], [0, 7, 30]], atol=1e-12)
    # At 90 degrees the array lies along +y, and its elevation axis along -x.
    np.testing.assert_allclose(Pose(0, 50, 90).to_probe(points) * 1e3, [[0, -5, 50], [7, -5, 30]], atol=1e-12)


def test_half_a_turn_mirrors_exactly():
    points = np.random.default_rng(0).uniform(-0.04, 0.04, (100, 3))
    turned = Pose(5, 50, 195).to_probe(points)
    np.testing.assert_array_equal(turned, Pose(5, 50, 15).to_probe(points) * [-1, -1, 1])


def test_positions_of_another_shape_are_refused():
    with pytest.raises(ValueError, match=r"shape \(n, 3\), not \(3,\)"):
        Pose().to_probe(np.zeros(3))
