"""How an image lies under the probe: axes by hand, and what cannot be."""

import numpy as np
import pytest
from volumes import ORIGIN, SPACING, image, turned

from usbench.envs.anatomy.placement import AXES, Placement
from usbench.envs.anatomy.volume import Volume

# Of the voxels' centres, in mm, in a file without a turn: x, y, z of its world.
LOW, HIGH = np.array([-20.0, 35.0, 7.0]), np.array([-14.0, 45.0, 17.0])


def volume(directions=None):
    made = image(np.ones((5, 6, 5), np.uint8), SPACING, ORIGIN, directions)
    places = (made.GetSpacing(), made.GetOrigin(), np.reshape(made.GetDirection(), (3, 3)))
    return Volume(np.ones((5, 6, 5), np.uint8), *map(np.array, places))


def test_by_default_the_files_z_leads_down_from_the_middle_of_its_top():
    zero, axes = Placement().frame(volume())
    np.testing.assert_allclose(zero, [-17, 40, 7])
    np.testing.assert_allclose(axes, np.eye(3), atol=1e-15)


@pytest.mark.parametrize(
    ("lateral", "down", "elevation", "zero"),
    [
        ("x", "-y", [0, 0, 1], [-17, 45, 12]),
        ("-x", "y", [0, 0, 1], [-17, 35, 12]),
        ("y", "x", [0, 0, 1], [-20, 40, 12]),
        ("-z", "x", [0, 1, 0], [-20, 40, 12]),
        ("y", "-z", [1, 0, 0], [-17, 40, 17]),
    ],
)
def test_other_axes_by_hand(lateral, down, elevation, zero):
    # By the right hand: thumb along the array, middle finger down, index finger as elevation.
    found, axes = Placement(lateral, down).frame(volume())
    np.testing.assert_allclose(axes[:, 1], elevation, atol=1e-15)
    np.testing.assert_allclose(found, zero)


def test_every_pair_of_axes_at_right_angles_is_right_handed_and_no_other_is_taken():
    turn = volume(turned((30.0, 0.0)))  # z and k are one
    allowed = 0
    for lateral in AXES:
        for down in AXES:
            try:
                _, axes = Placement(lateral, down).frame(turn)
            except ValueError as error:
                assert f"right angles, not {lateral!r} and {down!r}" in str(error)
            else:
                allowed += 1
                np.testing.assert_allclose(axes.T @ axes, np.eye(3), atol=1e-12)
                assert np.linalg.det(axes) == pytest.approx(1)
    # Of {x, y}, {i, j} and {z, k}: xy, ij, each of the four with z and with k; all orders and signs.
    assert allowed == (1 + 1 + 4 * 2) * 2 * 4


def test_axes_of_the_voxels_straighten_a_turned_image():
    directions = turned()
    zero, axes = Placement("i", "k").frame(volume(directions))
    np.testing.assert_allclose(axes, directions, atol=1e-12)
    np.testing.assert_allclose(zero, np.array(ORIGIN) + directions @ [3, 5, 0], atol=1e-12)


def test_the_probes_zero_is_shifted_along_its_own_axes():
    placement = Placement("x", "-y", center_x_mm=1.5, center_y_mm=-2.0, skin_mm=3.0)
    zero, _ = placement.frame(volume())
    np.testing.assert_allclose(zero, [-17 + 1.5, 45 - 3.0, 12 - 2.0])


@pytest.mark.parametrize(
    ("settings", "error", "said"),
    [
        ({"down": "w"}, ValueError, "down must be one of x, -x, .* not 'w'"),
        ({"lateral": "+x"}, ValueError, "lateral must be one of .* not '\\+x'"),
        ({"lateral": 1}, ValueError, "lateral must be one of .* not 1"),
        ({"skin_mm": "deep"}, TypeError, "skin_mm must be a finite number, not 'deep'"),
        ({"center_x_mm": float("nan")}, ValueError, "center_x_mm must be a finite number, not nan"),
        ({"center_y_mm": float("inf")}, ValueError, "center_y_mm must be a finite number, not inf"),
        ({"skin_mm": True}, TypeError, "skin_mm must be a finite number, not True"),
    ],
)
def test_what_is_no_placement_is_refused(settings, error, said):
    with pytest.raises(error, match=said):
        Placement(**settings)
