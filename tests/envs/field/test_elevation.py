"""Elevation: the factor of an element's height, and the short filter that stands for it."""

import numpy as np
import pytest

from usbench import read_probe
from usbench.envs.field.elevation import HALF, WHOLE, elevation_factor, elevation_taps
from usbench.envs.probe import LinearArray

ARRAY = LinearArray()
F0 = np.array([ARRAY.center_frequency])
# Np / (m Hz); the second, 30 dB/(cm MHz), so strong that the longer ways of a few mm count.
ATTENUATIONS = [0.0, 3.5e-4]


def test_far_away_it_is_the_directivity_of_a_rectangle():
    # Fraunhofer: sinc(h sin(theta) / wavelength), with its null at wavelength / h.
    rho, wavelength = 2.0, ARRAY.wavelength
    for sine in (0.0, 0.03, 0.06, wavelength / 5e-3):
        y = rho * np.tan(np.arcsin(sine))
        factor, extra = elevation_factor(ARRAY, y, np.array([rho]), F0)
        cosine = np.cos(np.arcsin(sine))  # rho / r of the definition
        assert abs(factor[0, 0]) == pytest.approx(cosine * abs(np.sinc(5e-3 * sine / wavelength)), abs=6e-3)
        assert extra[0] == pytest.approx(np.hypot(rho, y) - rho, abs=1e-6)


@pytest.mark.parametrize("attenuation", ATTENUATIONS)
def test_near_by_it_is_the_integral_over_the_height(attenuation):
    y, rho = 1.5e-3, 20e-3
    s = np.linspace(-2.5e-3, 2.5e-3, 20001)
    r = np.hypot(rho, y - s)
    expected = np.mean(
        rho / r * np.exp(-2j * np.pi * F0[0] * (r - rho) / 1540 - attenuation * F0[0] * (r - rho))
    )
    factor, extra = elevation_factor(ARRAY, y, np.array([rho]), F0, attenuation)
    ours = factor[0, 0] * np.exp(-2j * np.pi * F0[0] * extra[0] / 1540)
    assert abs(ours - expected) < 0.02


def filter_of(taps, row, column):
    """The taps that are used there, complex, and their offsets in samples."""
    values = taps.taps[row, column, 0::2] + 1j * taps.taps[row, column, 1::2]
    used = {1: [1], 3: [0, 1, 2], 7: range(7)}[taps.n_taps[row, column]]
    return values[used], np.array(WHOLE + HALF)[used]


def test_in_the_plane_the_filter_does_nothing():
    taps = elevation_taps(ARRAY, 2e-3, 50e-3)
    assert taps.path[0] == pytest.approx(0, abs=1e-12)
    for column in range(taps.taps.shape[1]):
        weights, offsets = filter_of(taps, 0, column)
        turns = np.outer(np.linspace(-0.3, 0.3, 7), offsets)  # of the I/Q's rate
        assert np.exp(-2j * np.pi * turns) @ weights == pytest.approx(1, abs=1e-2)


@pytest.mark.parametrize("y, rho", [(1e-3, 30e-3), (2.5e-3, 50e-3), (5e-3, 85e-3), (5e-3, 30e-3)])
@pytest.mark.parametrize("attenuation", ATTENUATIONS)
def test_filter_has_the_spectrum_of_the_factor(y, rho, attenuation):
    taps = elevation_taps(ARRAY, 5e-3, 90e-3, attenuation)
    f = ARRAY.center_frequency + np.linspace(-0.8e6, 0.8e6, 9)
    row, column = round(y / taps.y_step), round(rho / taps.distance_step)
    weights, offsets = filter_of(taps, row, column)
    middle, rate = ARRAY.iq_center_frequency, ARRAY.iq_sampling_frequency
    delayed = np.exp(-2j * np.pi * np.outer(f - middle, offsets / rate)) @ weights
    ours = delayed * np.exp(-2j * np.pi * f * taps.path[row, column] / 1540)
    both = [elevation_factor(ARRAY, position, np.array([rho]), f, attenuation) for position in (y, 0.0)]
    whole = [factor[0] * np.exp(-2j * np.pi * f * extra[0] / 1540) for factor, extra in both]
    expected = (whole[0] / whole[1]) ** 2
    assert np.abs(ours - expected).max() < 0.1 * np.abs(expected).max() + 0.001


@pytest.mark.parametrize("name", ["l7-4", "l11-4v", "l12-5"])
@pytest.mark.parametrize("y, rho", [(1e-3, 12e-3), (3e-3, 20e-3), (5e-3, 30e-3), (7e-3, 45e-3)])
def test_filter_of_a_tall_element_has_the_spectrum_of_the_factor_with_its_further_taps(name, y, rho):
    array = read_probe(name)
    taps = elevation_taps(array, 10e-3, 60e-3)
    middle, rate, c = array.iq_center_frequency, array.iq_sampling_frequency, array.speed_of_sound
    f = middle + np.linspace(-0.5, 0.5, 201) * rate
    row, column = round(y / taps.y_step), round(rho / taps.distance_step)
    weights, offsets = filter_of(taps, row, column)
    delays = np.exp(-2j * np.pi * np.outer(f - middle, offsets / rate))
    # Taps delay the envelope; a longer path delays the wave with its phase.
    ours = delays @ weights
    short = np.exp(-2j * np.pi * np.outer(f - middle, np.array(WHOLE + HALF) / rate))
    for values, longer in zip(taps.further[:, row, column], taps.further_path, strict=True):
        ours = ours + (short @ (values[0::2] + 1j * values[1::2])) * np.exp(-2j * np.pi * f * longer / c)
    both = [elevation_factor(array, position, np.array([rho]), f) for position in (y, 0.0)]
    (factor, extra), (on_plane, on_plane_extra) = both
    way = 2 * (extra - on_plane_extra) - taps.path[row, column]
    expected = (factor / on_plane)[0] ** 2 * np.exp(-2j * np.pi * f * way / c)
    weight = np.abs(array.pulse_spectrum(f) * on_plane[0] ** 2)  # the echo on the plane, which is filtered
    errors = [
        np.linalg.norm((one - expected) * weight) / np.linalg.norm(expected * weight)
        for one in (ours, delays @ weights)
    ]
    assert errors[0] < 0.06
    if taps.n_further[row, column]:
        assert errors[1] > 2 * errors[0]  # without the further taps


def test_elements_that_are_not_tall_have_no_further_taps():
    taps = elevation_taps(ARRAY, 5e-3, 90e-3)
    assert len(taps.further) == 0 and not taps.n_further.any()


def test_points_that_need_further_taps_are_near_or_far_from_the_plane():
    taps = elevation_taps(read_probe("l7-4"), 10e-3, 60e-3)
    rows = np.rint(np.array([0.0, 8e-3]) / taps.y_step).astype(int)
    assert list(taps.need_further(rows, np.full(2, 20e-3))) == [False, True]
    used = np.argwhere(taps.n_further)
    assert taps.need_further(used[:, 0], used[:, 1] * taps.distance_step).all()


def test_filters_are_as_short_as_they_may_be():
    taps = elevation_taps(ARRAY, 5e-3, 90e-3)
    assert set(np.unique(taps.n_taps)) == {1, 3, 7}
    assert taps.n_taps[: round(0.5e-3 / taps.y_step), round(40e-3 / taps.distance_step) :].max() <= 3


def test_a_taller_element_hears_a_thinner_slice():
    # Far off, at 3 mm from the plane: sinc^2(h y / (wavelength rho)) of either height.
    levels = []
    for height in (2e-3, 5e-3):
        array = LinearArray(element_height=height)
        taps = elevation_taps(array, 3e-3, 90e-3)
        row, column = round(3e-3 / taps.y_step), round(85e-3 / taps.distance_step)
        weights, offsets = filter_of(taps, row, column)
        turns = (array.center_frequency - array.iq_center_frequency) / array.iq_sampling_frequency * offsets
        levels.append(abs(np.sum(weights * np.exp(-2j * np.pi * turns))))
        expected = np.sinc(height * 3e-3 / (array.wavelength * 85e-3)) ** 2
        assert levels[-1] == pytest.approx(expected, abs=0.06)
    assert levels[1] < levels[0]
