"""The beam against theory: its widths, its grating lobes, the thickness of its slice."""

import math

import numpy as np
import pytest
from echoes import SMALL, envelope, width

from usbench.envs.probe import LinearArray

pytestmark = pytest.mark.usefixtures("with_table")


def test_beam_is_narrowest_at_its_focus():
    lines = np.arange(0, 41) * 0.1e-3
    widths = [
        width(lines, envelope((0, 0, z), focal_depth=50e-3, lines=lines)[0].max(axis=0))
        for z in (35e-3, 50e-3, 70e-3)
    ]
    assert widths[1] == pytest.approx(1.05e-3, rel=0.05)  # the reference's
    assert widths[1] < widths[0] / 2 and widths[1] < widths[2] / 2


@pytest.mark.parametrize(
    "fields",
    [
        {},
        {"n_active": 16},
        {"center_frequency": 5e6},
        {"element_width": 0.3e-3},
        {"kerf": 0.15e-3},
    ],
)
def test_width_at_the_focus_is_wavelength_times_depth_over_aperture(fields):
    # -3 dB of a Hann window's transform, as it is heard twice: 1.44 bins (Harris 1978, table 1).
    array = LinearArray(**{**SMALL, **fields})
    lines = np.arange(0, 61) * array.pitch / 6
    profile = envelope((0, 0, 30e-3), array, 30e-3, lines)[0].max(axis=0)
    expected = 1.44 * array.wavelength * 30e-3 / ((array.n_active + 1) * array.pitch)
    assert width(lines, profile) == pytest.approx(expected, rel=0.12)


def test_a_wide_pitch_has_a_grating_lobe_where_theory_puts_it():
    array = LinearArray(**SMALL, element_width=0.5e-3, kerf=0.4e-3, excitation_cycles=8.0)
    angles = np.radians(np.arange(16.0, 45.0))
    points = 40e-3 * np.column_stack([np.sin(angles), 0 * angles, np.cos(angles)])
    peaks = [envelope(point, array, 40e-3)[0].max() for point in points]
    lobe = math.asin(array.wavelength / array.pitch)  # first order, 29 degrees
    assert angles[np.argmax(peaks)] == pytest.approx(lobe, abs=math.radians(2))


@pytest.mark.parametrize("height", [3e-3, 8e-3])
def test_taller_elements_hear_a_thinner_slice(height):
    array = LinearArray(**SMALL, element_height=height)
    points = [(0, y, 85e-3) for y in (0, 2e-3)]
    centre, beside = (envelope(point, array, 85e-3)[0].max() for point in points)
    expected = np.sinc(height * 2e-3 / (array.wavelength * 85e-3)) ** 2  # far field, there and back
    assert beside / centre == pytest.approx(expected, abs=0.12)


def test_the_nearest_line_hears_a_point_best():
    array = LinearArray(**SMALL, n_lines=21, line_spacing=1e-3)
    signals, _ = envelope((4.2e-3, 0, 30e-3), array, 30e-3, lines=None)
    assert signals.shape[1] == 21 and signals.max(axis=0).argmax() == 14  # at 4 mm
    chosen, _ = envelope((4.2e-3, 0, 30e-3), array, 30e-3, array.line_positions[[3, 14]])
    n = min(len(chosen), len(signals))
    assert chosen[:n] == pytest.approx(signals[:n, [3, 14]], abs=1e-4 * float(signals.max()))
