"""The transducer: section 3 of the specification, its pulse, and every value that it refuses."""

import dataclasses
import math
import pickle
import re

import numpy as np
import pytest

from usbench.envs.field.slow_sum import excited_pulse
from usbench.envs.probe import LinearArray


def test_defaults_are_those_of_the_specification():
    array = LinearArray()
    assert dataclasses.asdict(array) == {
        "center_frequency": 3.5e6,
        "sampling_frequency": 100e6,
        "speed_of_sound": 1540.0,
        "n_elements": 192,
        "element_width": 0.44e-3,
        "kerf": 0.05e-3,
        "element_height": 5e-3,
        "n_active": 64,
        "n_lines": 64,
        "line_spacing": 0.625e-3,
        "excitation_cycles": 2.0,
        "impulse_response_cycles": 2.0,
        "n_elevation": 10,
        "slice_thickness": 10e-3,
        "receive_focus": None,
        "receive_f_number": None,
    }
    assert array.pitch == pytest.approx(0.49e-3)
    assert array.wavelength == pytest.approx(0.44e-3)


def test_the_pulse_is_read_only():
    """Arrays that are equal share tables and frames, which a changed pulse would spoil."""
    with pytest.raises(ValueError, match="read-only"):
        LinearArray().pulse[:] *= 2


def test_lines_are_centred_and_equally_spaced():
    lines = LinearArray().line_positions
    assert lines == pytest.approx((np.arange(64) - 31.5) * 0.625e-3)
    assert LinearArray(n_lines=3, line_spacing=1e-3).line_positions == pytest.approx([-1e-3, 0, 1e-3])


def test_apodization_is_a_hann_window_without_zeros():
    assert LinearArray(n_active=3).apodization == pytest.approx([0.5, 1.0, 0.5])
    window = LinearArray().apodization
    assert window[0] > 0 and window == pytest.approx(window[::-1])
    assert window.sum() == pytest.approx(65 / 2)  # sum of sin^2(pi n / 65)


@pytest.mark.parametrize("n_active", [64, 31, 1])
def test_active_elements_are_the_nearest_to_the_line(n_active):
    array = LinearArray(n_active=n_active)
    elements = (np.arange(192) - 95.5) * array.pitch
    lines = np.array([-45e-3, -19.6875e-3, -0.3e-3, 0.1e-3, 12.34e-3, 60e-3])
    for line, center in zip(lines, array.aperture_centers(lines), strict=True):
        nearest = np.argsort(np.abs(elements - line), kind="stable")[:n_active]
        assert center == pytest.approx(elements[nearest].mean(), abs=1e-9)


def test_the_pulse_is_the_excitation_through_both_impulse_responses(reference):
    array = LinearArray()
    response = reference["impulse_response"]
    expected = np.convolve(np.convolve(reference["excitation"], response), response)
    assert array.pulse * array.sampling_frequency**2 == pytest.approx(expected, abs=1e-9 * expected.max())
    assert array.apodization == pytest.approx(reference["apodization"])


@pytest.mark.parametrize("fields", [{}, {"excitation_cycles": 4.5}, {"center_frequency": 5.3e6}])
def test_pulse_lasts_and_sounds_as_its_parts(fields):
    array = LinearArray(**fields)
    cycles = array.excitation_cycles + 2 * array.impulse_response_cycles
    assert len(array.pulse) / array.sampling_frequency == pytest.approx(
        cycles / array.center_frequency, abs=4e-8
    )
    assert array.pulse_delay == pytest.approx(cycles / array.center_frequency / 2, rel=0.02)  # symmetrical
    assert array.pulse == pytest.approx(excited_pulse(array), abs=1e-12 * array.pulse.max())
    frequencies = np.linspace(0, 2 * array.center_frequency, 401)
    power = np.abs(array.pulse_spectrum(frequencies)) ** 2
    assert frequencies @ power / power.sum() == pytest.approx(array.center_frequency, rel=0.02)


@pytest.mark.parametrize("sampling, center", [(100e6, 3.5e6), (50e6, 5e6), (80e6, 2e6), (40e6, 5.5e6)])
def test_sampling_rates_fit_each_other(sampling, center):
    array = LinearArray(sampling_frequency=sampling, center_frequency=center)
    assert 7 * center <= array.rf_sampling_frequency <= sampling
    assert sampling / array.rf_sampling_frequency == pytest.approx(
        round(sampling / array.rf_sampling_frequency)
    )
    assert array.iq_sampling_frequency * array.iq_decimation == pytest.approx(array.rf_sampling_frequency)
    assert array.iq_sampling_frequency >= 1.4 * center


def test_default_rf_rate_is_that_of_the_specification():
    assert LinearArray().rf_sampling_frequency >= 25e6


def test_is_a_value():
    array = LinearArray(n_active=32)
    assert array == LinearArray(n_active=32.0) and hash(array) == hash(LinearArray(n_active=32))
    assert pickle.loads(pickle.dumps(array)) == array
    with pytest.raises(dataclasses.FrozenInstanceError):
        array.n_active = 3


WHOLE = ("n_elements", "n_active", "n_lines", "n_elevation")
NAMES = [field.name for field in dataclasses.fields(LinearArray)]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("value", [-1, math.nan, math.inf])
def test_refuses_what_is_not_positive_and_finite(name, value):
    with pytest.raises(ValueError, match=rf"^{name} must be .*, not {value}\.$"):
        LinearArray(**{name: value})


@pytest.mark.parametrize("name", [name for name in NAMES if name != "kerf"])
def test_refuses_zero(name):
    with pytest.raises(ValueError, match=name):
        LinearArray(**{name: 0})


def test_kerf_may_be_zero():
    assert LinearArray(kerf=0).pitch == pytest.approx(0.44e-3)


@pytest.mark.parametrize("name", [name for name in NAMES if not name.startswith("receive")])
@pytest.mark.parametrize("value", ["3", None, True, [1.0]])
def test_refuses_what_is_no_number(name, value):
    with pytest.raises(TypeError, match=rf"^{name} must be a .*number.*, not {re.escape(repr(value))}\.$"):
        LinearArray(**{name: value})


@pytest.mark.parametrize("name", ["receive_focus", "receive_f_number"])
@pytest.mark.parametrize("value", [True, [1.0], b"dynamic"])
def test_refuses_a_receive_that_is_no_number(name, value):
    with pytest.raises(TypeError, match=rf"^{name} must be a .*number.*, not {re.escape(repr(value))}\.$"):
        LinearArray(**{name: value})


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        (
            {"receive_focus": "dynamics"},
            "receive_focus must be None, a depth in m or 'dynamic', not 'dynamics'.",
        ),
        (
            {"receive_focus": 30},
            "receive_focus must be a number in [0.0001, 0.5] m, not 30: did you mean 0.03",
        ),
        ({"receive_f_number": 0.01}, "receive_f_number must be a number in [0.1, 100], not 0.01."),
        ({"receive_f_number": 1000}, "receive_f_number must be a number in [0.1, 100], not 1000."),
    ],
)
def test_refuses_another_receive(fields, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        LinearArray(**fields)


def test_the_receive_is_that_of_the_transmit_unless_it_is_set_apart():
    assert not LinearArray().receives_apart and not LinearArray(receive_focus=0.03).receives_dynamically
    array = LinearArray(receive_focus="dynamic", receive_f_number=2)
    assert array.receives_apart and array.receives_dynamically and array == dataclasses.replace(array)
    depths = np.array([0.1e-3, 20e-3, 90e-3])
    assert array.receive_depths(50e-3, depths) == pytest.approx(depths)
    widths = 2 * array.receive_half_width(depths) - array.pitch
    assert widths == pytest.approx([array.pitch, 10e-3, array.aperture_width])


@pytest.mark.parametrize("name", WHOLE)
def test_refuses_broken_counts(name):
    with pytest.raises(ValueError, match=f"{name} must be a whole number from 1, not 2.5"):
        LinearArray(**{name: 2.5})


def test_refuses_more_active_elements_than_there_are():
    with pytest.raises(ValueError, match="n_active must be at most n_elements = 32, not 64"):
        LinearArray(n_elements=32)


def test_refuses_too_low_a_sampling_frequency():
    with pytest.raises(ValueError, match="sampling_frequency must be at least 7 times center_frequency"):
        LinearArray(sampling_frequency=20e6)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"center_frequency": 7}, "center_frequency must be .* Hz, not 7: did you mean 7e6 (7 MHz)?"),
        ({"center_frequency": 7e3}, "did you mean 7e6 (7000 kHz)?"),
        (
            {"center_frequency": 7e9},
            "center_frequency must be .* Hz, not 7000000000.0.",
        ),
        ({"sampling_frequency": 100}, "did you mean 1e8 (100 MHz)?"),
        ({"speed_of_sound": 1.54}, "did you mean 1540 (1.54 mm/us)?"),
        ({"element_width": 0.27}, "element_width must be .* m, not 0.27: did you mean 0.00027 (0.27 mm)?"),
        ({"element_width": 270}, "did you mean 0.00027 (270 um)?"),
        ({"kerf": 0.03}, "did you mean 3e-5 (0.03 mm)?"),
        ({"element_height": 5}, "did you mean 0.005 (5 mm)?"),
        ({"line_spacing": 0.3}, "did you mean 0.0003 (0.3 mm)?"),
        ({"slice_thickness": 10}, "did you mean 0.01 (10 mm)?"),
        ({"excitation_cycles": 2.8e-7}, "excitation_cycles must be a number in [0.25, 100], not 2.8e-07."),
        ({"kerf": 2e-3}, "kerf, the gap between elements, must be at most 4 times element_width (0.00176 m)"),
        ({"element_width": 5e-3, "n_active": 8}, "element_width + kerf must be between .* not 0.00505."),
        ({"center_frequency": 1e5, "element_width": 1e-6, "kerf": 0}, "not 1e-6."),
        ({"n_elements": 2000}, "n_elements times the pitch must be at most 0.5 m, not 0.98 m."),
        ({"n_lines": 2000}, "n_lines times line_spacing must be at most 0.5 m, not 1.25 m."),
        ({"n_elevation": 10**6}, "n_elevation must be at most 1000, not 1000000."),
    ],
)
def test_refuses_values_in_another_unit_and_out_of_proportion(fields, message):
    with pytest.raises(ValueError, match=re.escape(message).replace(r"\.\*", ".*")):
        LinearArray(**fields)


@pytest.mark.parametrize(
    "fields",
    [
        {"center_frequency": 0.2e6, "n_elements": 64, "element_width": 2e-3},  # through the skull
        {"center_frequency": 50e6, "sampling_frequency": 400e6, "element_width": 20e-6, "kerf": 5e-6},
        {"element_width": 0.25e-3, "kerf": 0.73e-3},  # every second element of a sparse array
        {"speed_of_sound": 5900.0, "center_frequency": 5e6},  # steel
        {"n_elements": 1, "n_active": 1, "element_width": 1e-5, "element_height": 1e-5},
    ],
)
def test_takes_unusual_arrays(fields):
    assert LinearArray(**fields).wavelength > 0
