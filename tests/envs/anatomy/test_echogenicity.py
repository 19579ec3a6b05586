"""Tissue from an image: scatterers as strong as it is bright, and the frames that are simulated of them."""

import math

import numpy as np
import pytest

from usbench.envs.anatomy import Echogenicity
from usbench.envs.anatomy.placement import Placement
from usbench.envs.anatomy.simulated import _scatterers
from usbench.envs.pose import Pose
from usbench.envs.scanner import scan

# Half width and half thickness that the default probe sees.
VIEW = 0.020, 0.005


def test_scatterers_are_as_strong_as_the_image_is_bright(image):
    path = image(lambda x, y, z: 60 + 50 * np.sign(x), (81, 81, 91), origin=(-40, -40, 0))
    tissue = Echogenicity.read(path)
    positions, amplitudes = _scatterers(tissue)
    # Half the image is 110 and half is 10, one plane of voxels between them; all of the box is in it.
    assert len(positions) == round(tissue.density_per_mm3 * 80 * 80 * 90)
    dark, bright = amplitudes[positions[:, 0] < -1e-3], amplitudes[positions[:, 0] > 1e-3]
    # The error of a standard deviation is 1 / sqrt(2 n): five of them.
    for values, strength in ((dark, 10 / 110), (bright, 1.0)):
        assert values.std() == pytest.approx(strength, rel=5 / math.sqrt(2 * len(values)))
        assert abs(values.mean()) < 5 * strength / math.sqrt(len(values))
    # Normal: the fourth moment is three times the square of the second, with an error of sqrt(96 / n).
    kurtosis = np.mean(bright**4) / np.mean(bright**2) ** 2
    assert kurtosis == pytest.approx(3, abs=5 * math.sqrt(96 / len(bright)))


def test_between_voxels_the_strength_is_interpolated(image):
    # From 0 to 100 over 20 mm: the variance is the square of the distance.
    path = image(lambda x, y, z: 5.0 * x, (5, 17, 19), (5.0, 5.0, 5.0), (0, -40, 0))
    tissue = Echogenicity.read(path, placement=Placement(center_x_mm=-10.0), density_per_mm3=1.0)
    positions, amplitudes = _scatterers(tissue)
    x_mm = positions[:, 0] * 1e3
    for low in range(1, 20):
        part = amplitudes[(x_mm >= low) & (x_mm < low + 1)]
        expected = ((low + 1) ** 3 - low**3) / 3 / 20**2
        assert np.mean(part**2) == pytest.approx(expected, rel=5 * math.sqrt(2 / len(part)) + 0.01)
    assert x_mm.min() > 0 and x_mm.max() < 20


def test_decibels_become_strengths(image):
    path = image(lambda x, y, z: 50 + 50.0 * (x > 0), (81, 81, 91), origin=(-40, -40, 0))
    positions, amplitudes = _scatterers(Echogenicity.read(path, dynamic_range_db=60))
    dark = amplitudes[positions[:, 0] < -1e-3]
    # Half of the shade is half of the decibels.
    assert 20 * np.log10(dark.std()) == pytest.approx(-30, abs=0.2)


def test_there_are_none_where_the_image_is_black_or_ends(image):
    path = image(lambda x, y, z: 9.0 * (z > 20), (21, 21, 41), origin=(-10, -10, 0))
    positions, _ = _scatterers(Echogenicity.read(path))
    expected = 20 * 20 * 20 * 10_000 / 36_000
    assert len(positions) == pytest.approx(expected, abs=5 * math.sqrt(expected))
    low, high = positions.min(axis=0) * 1e3, positions.max(axis=0) * 1e3
    assert (low > [-10, -10, 20]).all() and (high < [10, 10, 40]).all()


def test_speckle_is_the_seeds_and_fixed_to_the_tissue(tissue_file):
    one = Echogenicity.read(tissue_file, seed=3)
    again, other = (
        Echogenicity.read(tissue_file, seed=3, target=Pose(5, 40, 0)),
        Echogenicity.read(tissue_file, seed=4),
    )
    for mine, its in zip(
        one.in_view(Pose(5, 50, 30), *VIEW), again.in_view(Pose(5, 50, 30), *VIEW), strict=True
    ):
        np.testing.assert_array_equal(mine, its)
    assert not np.array_equal(one.in_view(Pose(), *VIEW)[1][:100], other.in_view(Pose(), *VIEW)[1][:100])
    # What two poses see alike are the same scatterers.
    pose, moved = Pose(0, 50, 0), Pose(5, 50, 0)
    here, there = ({*one.in_view(where, *VIEW)[1].tolist()} for where in (pose, moved))
    assert 0.8 < len(here & there) / len(here) < 0.95  # 35 mm of 40
    positions, _ = one.in_view(pose, *VIEW)
    assert (np.abs(positions) <= [0.020, 0.005, 0.090]).all()


def test_the_simulator_shows_the_image(image):
    # A ball 20 dB above the tissue around, to the right of the middle.
    def tissue(x, y, z):
        return np.where((x - 6) ** 2 + y**2 + (z - 45) ** 2 < 8**2, 100.0, 10.0)

    path = image(tissue, (81, 41, 91), origin=(-40, -20, 0))
    frame = scan(Echogenicity.read(path), Pose(0, 50, 0))
    decibels = frame.astype(float) / 255 * 60
    row, column = np.mgrid[0:90, 0:40]
    distance = np.hypot(column - 19.5 - 6, row + 0.5 - 45)
    around = (distance > 12) & (np.abs(row - 45) < 12)
    # Speckle has the same mean in decibels above and below; side lobes fill the tissue around a little.
    assert decibels[distance < 5].mean() - decibels[around].mean() == pytest.approx(20, abs=4)


def test_what_attenuates_is_darker_below(tissue_file):
    plain, lossy = (
        scan(Echogenicity.read(tissue_file, attenuation_db_per_cm_mhz=loss), Pose()) for loss in (0.0, 0.5)
    )
    rows = (np.arange(90) + 0.5) * 0.1  # cm
    below = slice(20, 80)
    lost_db = (plain.astype(float) - lossy).mean(axis=1)[below] * 60 / 255
    # There and back, at 3.5 MHz; the spectrum's shift to lower frequencies loses a little less.
    slope = np.polyfit(rows[below], lost_db, 1)[0]
    assert slope == pytest.approx(2 * 0.5 * 3.5, rel=0.15)


@pytest.mark.parametrize("loss", [-0.1, float("nan"), "much"])
def test_attenuation_that_cannot_be_is_refused(tissue_file, loss):
    with pytest.raises((TypeError, ValueError), match="attenuation_db_per_cm_mhz must be"):
        Echogenicity.read(tissue_file, attenuation_db_per_cm_mhz=loss)
