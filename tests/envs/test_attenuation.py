"""Attenuation against theory: what is lost on the way, lower echoes from deeper, nothing when it is off."""

from functools import partial

import numpy as np
import pytest
from echoes import CLOUD, SMALL, WEIGHTS, correlation

from usbench.envs.anatomy import Echogenicity
from usbench.envs.anatomy.points import PointScatterers
from usbench.envs.attenuation import LARGEST
from usbench.envs.field.slow_sum import slow_rf
from usbench.envs.phantom import Phantom
from usbench.envs.probe import LinearArray
from usbench.envs.rf import simulate_iq, simulate_rf

FOCUS = 60e-3
ATTENUATION = 0.7
# So narrow that all of it is as far off as its middle.
NARROW = {"n_elements": 16, "n_active": 8}
# Frequencies at which the pulse is loud, Hz.
BAND = np.arange(2.7e6, 4.3e6, 0.2e6)


def spectrum(depth, attenuation, frequencies=BAND, **fields):
    """Magnitude of the spectrum of a point's echo on the axis, (n_frequencies,)."""
    array = LinearArray(**NARROW, **fields)
    rf, time = simulate_rf([(0, 0, depth)], [1.0], array, FOCUS, [0.0], attenuation_db_per_cm_mhz=attenuation)
    return np.abs(np.exp(-2j * np.pi * np.outer(frequencies, time)) @ rf[:, 0])


def moments(power, frequencies):
    """Mean and variance of a power spectrum."""
    mean = frequencies @ power / power.sum()
    return mean, (frequencies - mean) ** 2 @ power / power.sum()


def test_an_echo_loses_twice_its_depth_times_frequency():
    for depth in (20e-3, 45e-3, 45.5e-3, 60e-3, 85e-3):
        lost = 20 * np.log10(spectrum(depth, 0.0) / spectrum(depth, ATTENUATION))
        expected = ATTENUATION * 2 * depth * 1e2 * BAND / 1e6
        assert lost == pytest.approx(expected, rel=0.025)
        assert lost.mean() == pytest.approx(expected.mean(), rel=0.005)


def test_between_the_depths_of_the_table_an_echo_is_lost_as_steadily(with_table):
    """Waveforms are those of the nearest depth in the table, so that the way from there has to count."""
    depths = np.arange(41e-3, 45e-3, 0.1e-3)
    lost = [20 * np.log10(spectrum(depth, 0.0) / spectrum(depth, ATTENUATION)).mean() for depth in depths]
    slope = ATTENUATION * 2 * 1e2 * BAND.mean() / 1e6
    assert np.diff(lost) == pytest.approx(np.full(len(depths) - 1, slope * 0.1e-3), abs=0.02)


def test_the_centre_frequency_falls_with_depth_and_the_bandwidth_squared():
    # A spectrum exp(-(f - f0)^2 / (2 s^2)) times exp(-2 b f d) is the same, 2 b d s^2 lower; the variance of
    # its power is s^2 / 2. Pulses here are no Gaussians, but nearly.
    frequencies = np.arange(1.2e6, 5.2e6, 0.02e6)
    for cycles in (2.0, 4.0):
        fields = {"excitation_cycles": cycles, "impulse_response_cycles": cycles}
        for depth in (35e-3, 70e-3):
            before, variance = moments(spectrum(depth, 0.0, frequencies, **fields) ** 2, frequencies)
            after, _ = moments(spectrum(depth, ATTENUATION, frequencies, **fields) ** 2, frequencies)
            nepers = ATTENUATION / 8.685889638 * 1e2 / 1e6
            assert before - after == pytest.approx(4 * nepers * depth * variance, rel=0.06)


@pytest.mark.parametrize(
    ("y", "z"), [(0.0, 12e-3), (2.5e-3, 12e-3), (5e-3, 12e-3), (2.5e-3, 30e-3), (5e-3, 30e-3)]
)
def test_points_off_the_image_plane_lose_on_their_own_way(y, z):
    point, array = [(0.0, y, z)], LinearArray(**NARROW)
    sizes = []
    for attenuation in (0.0, ATTENUATION):
        rf, time = simulate_rf(point, [1.0], array, FOCUS, [0.0], attenuation_db_per_cm_mhz=attenuation)
        expected = slow_rf(point, [1.0], array, FOCUS, [0.0], attenuation, time)[0]
        sizes.append(np.linalg.norm(rf) / np.linalg.norm(expected))
    assert sizes[1] / sizes[0] == pytest.approx(1.0, abs=2e-3)


def test_lines_beyond_the_end_of_the_array_lose_as_much():
    # The array is 8 mm wide.
    array, point, line = LinearArray(**NARROW), [(4e-3, 0.0, 40e-3)], [4e-3]
    rf, time = simulate_rf(point, [1.0], array, FOCUS, line, attenuation_db_per_cm_mhz=ATTENUATION)
    expected = slow_rf(point, [1.0], array, FOCUS, line, ATTENUATION, time)[0]
    assert np.linalg.norm(rf) / np.linalg.norm(expected) == pytest.approx(1.0, rel=0.05)


def test_without_it_every_bit_is_as_ever():
    array, points = LinearArray(**NARROW), CLOUD * [0, 1, 1]
    plain = simulate_iq(points, WEIGHTS, array, FOCUS, [0.0])[0]
    off, on = (
        simulate_iq(points, WEIGHTS, array, FOCUS, [0.0], attenuation_db_per_cm_mhz=attenuation)[0]
        for attenuation in (0.0, ATTENUATION)
    )
    assert plain.tobytes() == off.tobytes() != on.tobytes()


@pytest.mark.parametrize("value", [-0.5, float("nan"), float("inf")])
def test_what_is_no_attenuation_is_refused(value):
    said = "attenuation_db_per_cm_mhz must be a non-negative number, not"
    with pytest.raises(ValueError, match=said):
        Phantom(attenuation_db_per_cm_mhz=value)
    with pytest.raises(ValueError, match=said):
        simulate_rf([(0, 0, 0.03)], [1.0], LinearArray(**SMALL), 0.04, attenuation_db_per_cm_mhz=value)


@pytest.mark.parametrize("value", [1.0001, 3, 10.0, 1e300])
def test_more_than_can_be_simulated_is_refused(value, tissue_file):
    point = [(0, 0, 0.03)], [1.0]
    for made in (
        Phantom,
        partial(Echogenicity.read, tissue_file),
        partial(PointScatterers, *point),
        partial(simulate_rf, *point, LinearArray(**SMALL), 0.04),
    ):
        with pytest.raises(
            ValueError, match=r"attenuation_db_per_cm_mhz must be in \[0, 1\], .* wrong .*, not \d"
        ):
            made(attenuation_db_per_cm_mhz=value)


@pytest.mark.parametrize(("depth", "most"), [(30e-3, 0.05), (50e-3, 0.06), (80e-3, 0.19)])
def test_the_most_that_is_allowed_leaves_echoes_that_are_right(depth, most, with_table):
    array, line = LinearArray(), LinearArray().line_positions[31:32]
    point = [(0, 0, depth)], [1.0], array, 50e-3, line
    rf, time = simulate_rf(*point, attenuation_db_per_cm_mhz=LARGEST)
    expected = slow_rf(*point, LARGEST, time)[0]
    assert np.linalg.norm(rf - expected) / np.linalg.norm(expected) < most


def test_a_text_is_refused():
    with pytest.raises(TypeError, match="attenuation_db_per_cm_mhz must be a non-negative number, not '0.5'"):
        Phantom(attenuation_db_per_cm_mhz="0.5")


def test_rf_is_that_of_the_exact_model(with_table):
    attenuation, array, lines = 0.4, LinearArray(**SMALL), np.array([-4.1e-3, 6.33e-3])
    rf, time = simulate_rf(CLOUD, WEIGHTS, array, 40e-3, lines, attenuation_db_per_cm_mhz=attenuation)
    expected = slow_rf(CLOUD, WEIGHTS, array, 40e-3, lines, attenuation, time)[0]
    assert correlation(rf, expected) >= 0.98
    assert np.linalg.norm(rf) / np.linalg.norm(expected) == pytest.approx(1.0, rel=0.05)
