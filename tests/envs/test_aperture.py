"""The one-way response against the sum over elements, written out."""

import exact
import numpy as np
import pytest

from usbench.envs.aperture import LANES, one_way
from usbench.envs.probe import LinearArray

FLAT = LinearArray(n_elevation=1, element_height=1e-6)  # no elevation: the aperture is a line of elements


def response(u, z, focal_depth, array=FLAT, offset=0.0):
    """What `one_way` gives at (u, z), with the delay put back, and its frequencies."""
    step, n = 0.05e6, 4 * LANES
    frequencies = array.center_frequency + (np.arange(n) - n // 2) * step
    ones, zeros = np.ones((4000, n), np.float32), np.zeros((4000, n), np.float32)
    real, imag, lane_real, lane_imag = (np.zeros(size, np.float32) for size in (n, n, LANES, LANES))
    one_way(
        u, z, focal_depth, offset, array.apodization, array.pitch, array.element_width, array.speed_of_sound,
        frequencies[0], step, ones, zeros, 0.05e-3, real, imag, lane_real, lane_imag,
    )  # fmt: skip
    delay = np.exp(-2j * np.pi * frequencies * np.hypot(u, z) / array.speed_of_sound)
    return (real + 1j * imag) * delay, frequencies


@pytest.mark.parametrize("u, z, focal_depth", [(0, 0.05, 0.05), (3e-3, 0.02, 0.05), (-14e-3, 0.03, 0.02)])
@pytest.mark.parametrize("line", [0.0, 0.2e-3])
def test_equals_the_sum_over_elements(u, z, focal_depth, line):
    offset = float(line - FLAT.aperture_centers(np.array([line]))[0])
    spectrum, frequencies = response(u, z, focal_depth, offset=offset)
    expected = exact.one_way((line + u, 0.0, z), FLAT, focal_depth, line, frequencies)
    expected = expected * 2 * np.pi / (FLAT.element_width * FLAT.element_height)
    assert np.abs(spectrum - expected).max() <= 4e-3 * np.abs(expected).max()


def test_all_elements_are_in_phase_at_the_focus():
    # |H| = sum of w_n / r_n sinc, the largest that it can be; the echo's one-way delay is F / c.
    spectrum, frequencies = response(0.0, 0.05, 0.05)
    x = (np.arange(64) - 31.5) * FLAT.pitch
    r = np.hypot(x, 0.05)
    at = np.searchsorted(frequencies, 3.5e6)
    directivity = np.sinc(frequencies[at] * FLAT.element_width * x / (r * 1540))
    assert abs(spectrum[at]) == pytest.approx((FLAT.apodization / r * directivity).sum(), rel=1e-4)
    assert np.angle(spectrum * np.exp(2j * np.pi * frequencies * 0.05 / 1540)) == pytest.approx(0, abs=1e-3)


def test_is_symmetrical_about_the_centre_of_the_aperture():
    left, right = response(-4e-3, 0.03, 0.05)[0], response(4e-3, 0.03, 0.05)[0]
    assert np.abs(left - right).max() <= 1e-4 * np.abs(left).max()
