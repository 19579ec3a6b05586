"""The object's geometry of Table I and the scatterers: density, amplitudes, what is in view, identity."""

import dataclasses
import pickle

import numpy as np
import pytest

from usbench.envs.phantom import ObjectOfInterest, Phantom
from usbench.envs.pose import Pose

# Half width and half thickness that the default probe sees.
VIEW = 0.020, 0.005


@pytest.fixture(scope="module")
def phantom():
    return Phantom()


def in_object(phantom, positions):
    return np.any([b.contains(positions * 1e3) for b in phantom.object_of_interest.balls], axis=0)


def test_the_default_object_is_that_of_the_specification():
    expected = [
        (0, 0, 50, 12),
        (0, 0, 33.2, 6),
        (-10.47, 0, 39.53, 4),
        (10.47, 0, 39.53, 4),
        (-10.47, 0, 60.47, 4),
        (10.47, 0, 60.47, 4),
    ]
    balls = [(*ball.center_mm, ball.radius_mm) for ball in ObjectOfInterest().balls]
    np.testing.assert_allclose(balls, expected, atol=0.006)


def test_the_object_moves_turns_and_scales_as_a_whole():
    balls = ObjectOfInterest(x_mm=5, depth_mm=40, angle_deg=90, scale=0.5).balls
    assert balls[0].center_mm == pytest.approx((5, 0, 40))
    assert balls[1].center_mm == pytest.approx((5, 0, 40 - 8.4))
    assert sorted(ball.center_mm[1] for ball in balls[2:]) == pytest.approx(
        [-5.23, -5.23, 5.23, 5.23], abs=0.01
    )
    assert [ball.radius_mm for ball in balls] == [6, 3, 2, 2, 2, 2]


def test_scatterers_fill_the_phantom_at_both_densities(phantom):
    positions_mm = phantom.positions * 1e3
    assert np.all(np.abs(positions_mm[:, :2]) <= 40)
    assert np.all((positions_mm[:, 2] >= 0) & (positions_mm[:, 2] <= 90))
    inside = in_object(phantom, phantom.positions)
    # Volumes by integration on a 0.5 mm grid, independent of how the scatterers are drawn.
    axis = np.arange(-19.75, 20, 0.5)
    grid = np.stack(np.meshgrid(axis, axis, axis + 50, indexing="ij"), axis=-1).reshape(-1, 3)
    volume = in_object(phantom, grid * 1e-3).sum() * 0.5**3
    expected_inside, expected_outside = volume * 10_000 / 36_000, (80 * 80 * 90 - volume) * 1_000 / 36_000
    assert abs(inside.sum() - expected_inside) < 5 * np.sqrt(expected_inside)
    assert abs((~inside).sum() - expected_outside) < 5 * np.sqrt(expected_outside)


def test_the_tissue_is_uniform():
    positions = np.concatenate([Phantom(seed=seed).positions for seed in range(50)])
    far = positions[np.abs(positions[:, 1]) > 0.012] * 1e3
    for axis, low, high in ((0, -40, 40), (2, 0, 90)):
        counts, _ = np.histogram(far[:, axis], bins=10, range=(low, high))
        chi_square = np.sum((counts - counts.mean()) ** 2) / counts.mean()
        assert chi_square < 27.9  # 0.1 % point of 9 degrees of freedom


def test_amplitudes_are_normal_with_std_1_outside_and_10_inside(phantom):
    inside = in_object(phantom, phantom.positions)
    for amplitudes, std in ((phantom.amplitudes[inside], 10), (phantom.amplitudes[~inside], 1)):
        assert abs(amplitudes.mean()) < 4 * std / np.sqrt(amplitudes.size)
        assert amplitudes.std() == pytest.approx(std, rel=4 / np.sqrt(2 * amplitudes.size))
        kurtosis = np.mean(amplitudes**4) / np.mean(amplitudes**2) ** 2
        assert kurtosis == pytest.approx(3, abs=5 * np.sqrt(96 / amplitudes.size))


def test_in_view_is_the_slab_under_the_probe(phantom):
    positions, amplitudes = phantom.in_view(Pose(), *VIEW)
    assert np.all(np.abs(positions[:, 0]) <= 0.020) and np.all(np.abs(positions[:, 1]) <= 0.005)
    assert len(positions) == len(amplitudes)
    # Of the slab 6 203 mm^3 lie in the balls (spherical segments), 29 797 mm^3 do not: 1 723 + 828.
    assert len(positions) == pytest.approx(2_551, rel=0.08)
    assert len(phantom.in_view(Pose(), 0.020, 0.0025)[0]) < len(positions)


@dataclasses.dataclass(frozen=True)
class Sunk(Pose):
    """A pose of another kind, from which some tissue lies behind the probe."""

    def to_probe(self, positions):
        return super().to_probe(positions) - [0, 0, 0.02]


def test_in_view_is_what_lies_in_front_of_the_probe(phantom):
    positions, amplitudes = phantom.in_view(Sunk(), *VIEW)
    every, _ = phantom.in_view(Pose(), *VIEW)
    assert positions[:, 2].min() > 0 and len(positions) == len(amplitudes)
    np.testing.assert_array_equal(positions, every[every[:, 2] > 0.02] - [0, 0, 0.02])


def test_the_tissue_stays_where_it_is_when_the_probe_moves(phantom):
    seen, amplitudes = phantom.in_view(Pose(5, 50, 0), *VIEW)
    expected = phantom.in_view(Pose(0, 50, 0), 0.025, 0.005)
    for position, amplitude in zip(seen[:50], amplitudes[:50], strict=True):
        match = np.flatnonzero(expected[1] == amplitude)
        np.testing.assert_allclose(expected[0][match[0]] - position, [0.005, 0, 0], atol=1e-12)


def test_equal_configurations_share_their_scatterers():
    assert Phantom(seed=3) == Phantom(seed=np.int64(3), width_mm=80)
    assert Phantom(seed=3).positions is Phantom(seed=3, width_mm=80).positions
    assert Phantom(seed=3) != Phantom(seed=4)
    assert not np.array_equal(Phantom(seed=3).positions[:50], Phantom(seed=4).positions[:50])


def test_a_moved_object_leaves_the_speckle_around_it_unchanged():
    before, after = Phantom(), Phantom(object_of_interest=ObjectOfInterest(x_mm=10, angle_deg=45))
    assert after.target == Pose(10, 50, 45)

    def tissue_far_away(phantom):
        far = np.abs(phantom.positions[:, 2] - 0.045) > 0.03
        return phantom.positions[far]

    np.testing.assert_array_equal(tissue_far_away(before), tissue_far_away(after))
    seen_before = before.in_view(before.target, 0.010, 0.003)
    seen_after = after.in_view(after.target, 0.010, 0.003)
    bright = [np.abs(amplitudes) > 10 for _, amplitudes in (seen_before, seen_after)]
    np.testing.assert_allclose(seen_before[0][bright[0]], seen_after[0][bright[1]], atol=1e-12)


def test_arrays_are_read_only_and_a_pickle_is_small(phantom):
    with pytest.raises(ValueError, match="read-only"):
        phantom.amplitudes[0] = 0
    with pytest.raises(ValueError, match="read-only"):
        phantom.positions[0] = 0
    with pytest.raises(dataclasses.FrozenInstanceError):
        phantom.seed = 1
    pickled = pickle.dumps(phantom)
    assert len(pickled) < 2_000
    assert pickle.loads(pickled) == phantom


@pytest.mark.parametrize(
    ("configuration", "error", "message"),
    [
        ({"seed": -1}, ValueError, "seed must be a whole number from 0, not -1"),
        ({"seed": 1.5}, ValueError, "seed must be a whole number"),
        ({"seed": "1"}, TypeError, "seed must be a whole number"),
        ({"width_mm": 0}, ValueError, "width_mm must be a positive number"),
        ({"depth_mm": float("nan")}, ValueError, "depth_mm must be a positive number"),
        ({"height_mm": "80"}, TypeError, "height_mm must be a positive number"),
        ({"tissue_density_per_mm3": -1}, ValueError, "tissue_density_per_mm3 must be a non-negative number"),
        ({"object_density_per_mm3": -1}, ValueError, "object_density_per_mm3 must be a non-negative number"),
        (
            {"tissue_amplitude_std": float("inf")},
            ValueError,
            "tissue_amplitude_std must be a non-negative number",
        ),
        ({"object_of_interest": None}, TypeError, "must be an ObjectOfInterest"),
        ({"width_mm": 20}, ValueError, "the object must lie inside the phantom"),
        ({"width_mm": 1e308, "height_mm": 1e308}, ValueError, r"at most 1e\+07 scatterers, .*, not inf"),
        ({"tissue_density_per_mm3": 100}, ValueError, r"at most 1e\+07 scatterers, .*, not 5.76e\+07"),
    ],
)
def test_a_bad_phantom_is_refused(configuration, error, message):
    with pytest.raises(error, match=message):
        Phantom(**configuration)


@pytest.mark.parametrize(
    ("configuration", "error", "message"),
    [
        ({"scale": 0}, ValueError, "scale must be a positive number"),
        ({"contrast": -1}, ValueError, "contrast must be a non-negative number"),
        ({"x_mm": 0.5}, ValueError, "x_mm must be a whole number"),
        ({"leg_radius_mm": "4"}, TypeError, "leg_radius_mm must be a positive number"),
    ],
)
def test_a_bad_object_is_refused(configuration, error, message):
    with pytest.raises(error, match=message):
        ObjectOfInterest(**configuration)
