"""RF against the exact model, where theory gives no number: other arrays, focal depths, lines and places."""

import numpy as np
import pytest
from echoes import ARRAY, CLOUD, SMALL, WEIGHTS, correlation

from usbench.envs.field.slow_sum import slow_rf
from usbench.envs.probe import LinearArray
from usbench.envs.rf import simulate_rf

pytestmark = pytest.mark.usefixtures("with_table")

LINES = np.array([-4.1e-3, 6.33e-3])


def check(array, focal_depth, lines=LINES, points=CLOUD, weights=WEIGHTS, bound=0.98):
    """RF against the exact model: correlation, and size within 1 dB."""
    rf, time = simulate_rf(points, weights, array, focal_depth, lines)
    expected = slow_rf(points, weights, array, focal_depth, lines, time=time)[0]
    assert correlation(rf, expected) >= bound
    assert np.linalg.norm(rf) / np.linalg.norm(expected) == pytest.approx(1.0, rel=0.12)


@pytest.mark.parametrize(
    "fields",
    [
        {"center_frequency": 2.5e6},
        {"center_frequency": 6e6},
        {"sampling_frequency": 50e6},
        {"speed_of_sound": 1450.0},
        {"element_width": 0.8e-3},
        {"kerf": 0.2e-3},
        {"n_active": 17},
        {"n_elements": 60},
        {"element_height": 8e-3},
        {"excitation_cycles": 1.3},
        {"impulse_response_cycles": 3.0},
        {"n_elevation": 1},
        {"n_elevation": 16},
    ],
    ids=str,
)
def test_every_field_of_the_array_counts(fields):
    check(LinearArray(**{**SMALL, **fields}), 40e-3)


@pytest.mark.parametrize("focal_depth", [5e-3, 7.7e-3, 90e-3, 0.2])
def test_any_focal_depth(focal_depth):
    check(LinearArray(**SMALL), focal_depth)


@pytest.mark.parametrize("focal_depth", [5e-3, pytest.param(10e-3, marks=pytest.mark.slow)])
def test_short_foci_of_the_whole_aperture(focal_depth):
    # Delays between neighbours exceed half a wavelength, hence grating lobes of several orders at once.
    rng = np.random.default_rng(8)
    points = rng.uniform([-0.02, -0.0025, 0.004], [0.02, 0.0025, 0.09], (30, 3))
    check(ARRAY, focal_depth, np.array([-1.25e-3, 6.5e-3]), points, rng.normal(size=30), bound=0.95)


@pytest.mark.slow
def test_an_array_of_very_wide_elements_has_many_lobes():
    # A pitch of 5 wavelengths: more orders than lobes of an ordinary array.
    array = LinearArray(element_width=2.1e-3, kerf=0.1e-3, n_elements=16, n_active=8)
    check(array, 20e-3, bound=0.95)


def test_waves_shorter_than_a_step_of_the_table():
    # The default array and its scene, a twelfth as large: 42 MHz.
    lengths = {"element_width": 0.3e-3, "kerf": 0.05e-3, "element_height": 5e-3}
    array = LinearArray(
        **{name: length / 12 for name, length in lengths.items()},
        n_elements=96,
        n_active=24,
        center_frequency=42e6,
        sampling_frequency=1.2e9,
    )
    rf, time = simulate_rf(CLOUD / 12, WEIGHTS, array, 40e-3 / 12, LINES / 12)
    expected = slow_rf(CLOUD / 12, WEIGHTS, array, 40e-3 / 12, LINES / 12, time=time)[0]
    assert correlation(rf, expected) >= 0.98
    assert np.linalg.norm(rf) == pytest.approx(np.linalg.norm(expected), rel=0.02)


def test_lines_beyond_the_end_of_the_array():
    array = LinearArray(**SMALL)  # 47 mm wide: the aperture's centre stays within 17.6 mm
    check(array, 40e-3, np.array([3e-3, 19e-3]), CLOUD + [8e-3, 0, 0])


def test_nothing_but_lines_beyond_the_end_of_the_array():
    check(LinearArray(**SMALL), 40e-3, np.array([18.5e-3]), CLOUD + [8e-3, 0, 0])


def test_scatterers_far_off():
    array = LinearArray(n_elements=240, n_active=16)
    points = CLOUD * [1, 1, 1.5] + [33e-3, 0, 0]  # to 45 mm from the centre, and to 105 mm of depth
    check(array, 80e-3, np.array([28e-3, 36.1e-3]), points)


def test_rf_lasts_until_the_latest_echo():
    # Far to the side of a short focus, the far end of the aperture hears it late.
    array, point = LinearArray(), [(15e-3, 0.0, 50e-3)]
    rf, time = simulate_rf(point, [1.0], array, 20e-3, [0.0])
    long = np.arange(2 * len(time)) * (time[1] - time[0])
    expected = slow_rf(point, [1.0], array, 20e-3, [0.0], time=long)[0]
    assert np.sum(expected[len(time) :] ** 2) <= 1e-3 * np.sum(expected**2)
