"""Every field of `LinearArray` moves the physics as theory says: one test per field.

Small apertures, and so few pairs that they are summed directly. Ratios everywhere, as echoes are far smaller
than the absolute tolerance of `approx`.
"""

import dataclasses
import math

import numpy as np
import pytest
from scipy import signal

from usbench.envs.bmode import DEFAULT_IMAGING, Imaging, bmode
from usbench.envs.field.slow_sum import excited_pulse
from usbench.envs.phantom import Phantom
from usbench.envs.pose import Pose
from usbench.envs.probe import LinearArray
from usbench.envs.rf import simulate_iq, simulate_rf
from usbench.envs.scanner import view

FOCUS = 30e-3
SMALL = LinearArray(n_elements=96, n_active=24)


def changed(**fields):
    return dataclasses.replace(SMALL, **fields)


def echo(array, point=(0.0, 0.0, FOCUS), line=0.0, focal_depth=FOCUS):
    """Envelope of one point (n_samples,), and its time."""
    iq, time = simulate_iq([point], [1.0], array, focal_depth, [line])
    return np.abs(iq[:, 0]), time


def centre_frequency(array):
    rf, time = simulate_rf([(0, 0, FOCUS)], [1.0], array, FOCUS, [0.0])
    power = np.abs(np.fft.rfft(rf[:, 0])) ** 2
    return np.fft.rfftfreq(len(rf), time[1]) @ power / power.sum()


def beam_width(array):
    """Full lateral width at -6 dB at the focus, m."""
    x = np.linspace(0, 6e-3, 121)
    peaks = np.abs(simulate_iq([(0, 0, FOCUS)], [1.0], array, FOCUS, x)[0]).max(axis=0)
    last = np.flatnonzero(peaks >= peaks[0] / 2)[-1]
    return 2 * float(np.interp(-peaks[0] / 2, -peaks[last : last + 2], x[last : last + 2]))


def spread(time, amplitude):
    """Variance in time of the energy of an envelope, s^2."""
    weight = amplitude**2 / np.sum(amplitude**2)
    return time**2 @ weight - (time @ weight) ** 2


def echo_spread(array):
    """The same of the echo of a point at the focus, far enough for all elements to be about as far."""
    amplitude, time = echo(array, (0, 0, 60e-3), focal_depth=60e-3)
    return spread(time, amplitude)


def test_center_frequency_is_that_of_the_echo_and_narrows_the_beam():
    slow, fast = changed(center_frequency=2.5e6), changed(center_frequency=5e6)
    assert centre_frequency(fast) / centre_frequency(slow) == pytest.approx(2.0, rel=0.06)
    assert beam_width(slow) / beam_width(fast) == pytest.approx(2.0, rel=0.1)


@pytest.mark.parametrize("rate", [50e6, 200e6])
def test_sampling_frequency_changes_no_echo(rate):
    # Of the same analogue pulse; units are arbitrary.
    here, there = (
        simulate_rf([(0, 0, FOCUS)], [1.0], array, FOCUS, [0.0])
        for array in (SMALL, changed(sampling_frequency=rate))
    )
    n = min(len(here[0]), len(there[0]))
    assert here[1][:n] == pytest.approx(there[1][:n])
    a, b = here[0][:n, 0].astype(float), there[0][:n, 0].astype(float)
    assert a @ b / np.linalg.norm(a) / np.linalg.norm(b) >= 0.99
    assert echo_spread(changed(sampling_frequency=rate)) / echo_spread(SMALL) == pytest.approx(1.0, rel=0.05)


def test_speed_of_sound_delays_the_echo_and_widens_the_beam():
    slow, fast = changed(speed_of_sound=1400.0), changed(speed_of_sound=1680.0)
    arrival = {}
    for array in (slow, fast):
        amplitude, time = echo(array)
        arrival[array] = time @ amplitude**2 / np.sum(amplitude**2) - array.pulse_delay
    assert arrival[slow] / arrival[fast] == pytest.approx(1.2, rel=0.01)
    assert beam_width(fast) / beam_width(slow) == pytest.approx(1.2, rel=0.05)


def test_n_elements_is_where_the_aperture_stops_to_follow_the_line():
    # 32 elements: the centre of the active 24 stays within 4 pitches of the array's.
    array = changed(n_elements=32)
    reach = 4 * array.pitch
    inside, unlimited = (echo(a, (reach, 0, FOCUS), reach)[0] for a in (array, SMALL))
    n = min(len(inside), len(unlimited))
    assert np.abs(inside[:n] - unlimited[:n]).max() <= 1e-3 * inside.max()
    # Beyond, the beam is steered: wide elements hear less from aside.
    line = reach + 8e-3
    steered, straight = (echo(a, (line + 1e-5, 0, FOCUS), line)[0].max() for a in (array, SMALL))
    sine = 8e-3 / math.hypot(8e-3, FOCUS)
    distance = FOCUS / math.hypot(8e-3, FOCUS)
    directivity = np.sinc(array.element_width * sine / array.wavelength)
    assert steered / straight == pytest.approx((distance * directivity) ** 2, rel=0.1)


def test_a_point_on_a_line_beyond_the_end_of_the_array_is_heard_once():
    array = changed(n_elements=32)
    for line in np.arange(30, 70, 8) * 1e-4:
        on, beside = (echo(array, (x, 0, FOCUS), line)[0].max() for x in (line, line + 1e-6))
        assert on / beside == pytest.approx(1.0, rel=0.01)


@pytest.mark.parametrize("element_width", [0.2e-3, 0.44e-3, 0.6e-3])
def test_element_width_makes_elements_louder_ahead_and_deafer_aside(element_width):
    # One element alone, as far from a point ahead as from one aside; the areas count there and back.
    lateral, depth = 15e-3, 26e-3
    distance = math.hypot(lateral, depth)
    one = changed(n_active=1, element_width=element_width, excitation_cycles=6.0)
    x = float(one.aperture_centers(np.zeros(1))[0])
    ahead, aside = (echo(one, point)[0].max() for point in [(x, 0, distance), (x + lateral, 0, depth)])
    reference = echo(changed(n_active=1, element_width=0.1e-3, excitation_cycles=6.0), (0, 0, distance))[
        0
    ].max()
    assert ahead / reference == pytest.approx((element_width / 0.1e-3) ** 2, rel=0.03)
    expected = np.sinc(element_width * lateral / distance / one.wavelength) ** 2
    assert aside / ahead == pytest.approx(expected, abs=0.03)


def test_kerf_widens_the_aperture_and_narrows_the_beam():
    gap = changed(kerf=0.295e-3)  # the pitch grows by one half
    assert beam_width(SMALL) / beam_width(gap) == pytest.approx(1.5, rel=0.06)


def test_element_height_grows_the_echo_and_thins_the_slice():
    low, tall = changed(element_height=2e-3), changed(element_height=4e-3)
    deep = 85e-3
    heard = {a: [echo(a, (0, y, deep), focal_depth=deep)[0].max() for y in (0, 4e-3)] for a in (low, tall)}
    assert heard[tall][0] / heard[low][0] == pytest.approx(4.0, rel=0.03)  # the area, there and back
    for array in (low, tall):
        expected = np.sinc(array.element_height * 4e-3 / (array.wavelength * deep)) ** 2  # far field
        assert heard[array][1] / heard[array][0] == pytest.approx(expected, abs=0.06)


def test_n_active_is_the_aperture():
    assert beam_width(changed(n_active=15)) / beam_width(changed(n_active=31)) == pytest.approx(2.0, rel=0.08)


@pytest.mark.parametrize("n_lines, line_spacing", [(11, 1e-3), (21, 0.5e-3), (8, 1.25e-3)])
def test_lines_stand_where_their_number_and_spacing_put_them(n_lines, line_spacing):
    array = changed(n_lines=n_lines, line_spacing=line_spacing)
    point = (2.5e-3, 0.0, FOCUS)
    rf, _ = simulate_rf([point], [1.0], array, FOCUS)
    assert rf.shape[1] == n_lines
    assert abs(array.line_positions[np.abs(rf).max(axis=0).argmax()] - 2.5e-3) <= line_spacing / 2 + 1e-9
    fine = Imaging(height_px=400, width_px=100, pixel_size=0.1e-3, median_size=1)
    image = bmode(
        rf, array.rf_sampling_frequency, array.line_positions, -array.pulse_delay, imaging=fine
    ).astype(float)
    bright = np.argwhere(image >= 0.8 * image.max()) * 0.1e-3
    assert bright[:, 0].mean() == pytest.approx(FOCUS, abs=0.2e-3)
    assert bright[:, 1].mean() - 5e-3 == pytest.approx(2.5e-3, abs=line_spacing / 2)


@pytest.mark.parametrize("field", ["excitation_cycles", "impulse_response_cycles"])
def test_more_cycles_last_longer_by_what_the_pulse_does(field):
    def pulse_spread(array):
        pulse = np.pad(excited_pulse(array), 400)
        return spread(np.arange(len(pulse)) / array.sampling_frequency, np.abs(signal.hilbert(pulse)))

    longer = changed(**{field: 5.0})
    expected = pulse_spread(longer) - pulse_spread(SMALL)
    assert expected > 0.5 / SMALL.center_frequency**2
    assert (echo_spread(longer) - echo_spread(SMALL)) / expected == pytest.approx(1.0, rel=0.04)


def test_n_elevation_converges():
    near = (0.0, 2e-3, 12e-3)
    peaks = {n: echo(changed(n_elevation=n), near, focal_depth=12e-3)[0].max() for n in (1, 10, 20)}
    assert peaks[20] / peaks[10] == pytest.approx(1.0, rel=0.02)
    assert abs(peaks[1] / peaks[10] - 1) > 0.02


def test_a_thicker_slice_shows_what_lies_farther_from_the_image_plane():
    phantom, pose = Phantom(), Pose()
    counts = [
        len(phantom.in_view(pose, *view(changed(slice_thickness=mm * 1e-3), DEFAULT_IMAGING))[1])
        for mm in (5, 10, 20)
    ]
    assert counts[0] < counts[1] < counts[2]
    # Tissue alone, far from the object, is evenly dense.
    positions, _ = phantom.in_view(Pose(x_mm=20), *view(changed(slice_thickness=20e-3), DEFAULT_IMAGING))
    assert 9e-3 < np.abs(positions[:, 1]).max() <= 10e-3


def test_a_new_field_is_noticed():
    tested = {
        "center_frequency", "sampling_frequency", "speed_of_sound", "n_elements", "element_width", "kerf",
        "element_height", "n_active", "n_lines", "line_spacing", "excitation_cycles",
        "impulse_response_cycles", "n_elevation", "slice_thickness",
        "receive_focus", "receive_f_number",  # in test_receive.py
    }  # fmt: skip
    assert {field.name for field in dataclasses.fields(LinearArray)} == tested
