"""RF against theory: when an echo comes, how it sounds, and what must change nothing."""

import math

import numpy as np
import pytest
from echoes import ARRAY, SMALL, correlation, envelope
from scipy import signal

from usbench.envs.probe import LinearArray
from usbench.envs.rf import simulate_iq, simulate_rf


@pytest.mark.parametrize("speed", [1540.0, 1450.0])
@pytest.mark.parametrize("depth", [30e-3, 50e-3, 80e-3])
def test_an_echo_arrives_after_twice_its_depth(speed, depth):
    array = LinearArray(**SMALL, speed_of_sound=speed)
    signals, time = envelope((0, 0, depth), array, depth)
    signals = signals[:, 0]
    arrival = 2 * depth / speed
    centre = time @ signals**2 / (signals @ signals)
    # The ends of the element lie farther off: sqrt(depth^2 + (2.5 mm)^2) at most.
    latest = 2 * math.hypot(depth, 2.5e-3) / speed
    assert arrival - 0.02e-6 <= centre - array.pulse_delay <= latest
    heard = time[signals >= 0.03 * signals.max()]
    step = time[1] - time[0]
    assert heard[0] >= arrival - step and heard[-1] <= latest + 2 * array.pulse_delay + step


def test_rf_is_the_real_part_of_its_iq():
    point = [(1e-3, 1e-3, 45e-3)]
    rf, time = simulate_rf(point, [1.0], ARRAY, 50e-3, [0.0])
    iq, iq_time = simulate_iq(point, [1.0], ARRAY, 50e-3, [0.0])
    assert rf.dtype == np.float32 and rf.shape == (len(time), 1) and time[0] == 0
    assert np.diff(time) == pytest.approx(1 / ARRAY.rf_sampling_frequency) and 1 / time[1] >= 25e6
    assert iq.dtype == np.complex64 and iq_time[1] == pytest.approx(1 / ARRAY.iq_sampling_frequency)
    every = time[:: ARRAY.iq_decimation][: len(iq)]
    carrier = np.exp(2j * np.pi * ARRAY.iq_center_frequency * (every - ARRAY.pulse_delay))
    expected = (iq[:, 0] * carrier).real
    assert rf[:: ARRAY.iq_decimation, 0] == pytest.approx(expected, abs=1e-4 * np.abs(expected).max())


def test_adds_up_and_scales():
    rng = np.random.default_rng(1)
    points = rng.uniform([-15e-3, -4e-3, 5e-3], [15e-3, 4e-3, 80e-3], (40, 3))
    points[0] = points[20] = [15e-3, 4e-3, 85e-3]  # so that both halves last equally long
    weights = rng.normal(size=40)
    lines = [-5e-3, 4e-3]
    whole, first, second = (
        simulate_iq(points[part], weights[part], ARRAY, 50e-3, lines)[0]
        for part in (slice(None), slice(20), slice(20, 40))
    )
    assert np.abs(first + second - whole).max() <= 1e-5 * np.abs(whole).max()
    assert np.abs(simulate_iq(points, -3 * weights, ARRAY, 50e-3, lines)[0] + 3 * whole).max() <= 1e-5 * (
        np.abs(whole).max()
    )


def test_order_of_the_scatterers_does_not_matter():
    rng = np.random.default_rng(2)
    points, weights = rng.uniform([-0.01, -0.004, 0.005], [0.01, 0.004, 0.08], (50, 3)), rng.normal(size=50)
    shuffled = rng.permutation(50)
    one = simulate_iq(points, weights, ARRAY, 50e-3, [0.0])[0]
    other = simulate_iq(points[shuffled], weights[shuffled], ARRAY, 50e-3, [0.0])[0]
    assert np.abs(one - other).max() <= 1e-5 * np.abs(one).max()


def test_left_and_right_front_and_back_are_alike():
    rng = np.random.default_rng(3)
    points, weights = rng.uniform([-0.02, -0.005, 0.005], [0.02, 0.005, 0.09], (60, 3)), rng.normal(size=60)
    here = simulate_rf(points, weights, ARRAY, 50e-3)[0]
    mirrored = simulate_rf(points * [-1, 1, 1], weights, ARRAY, 50e-3)[0][:, ::-1]
    assert correlation(here, mirrored) >= 0.9999
    assert np.array_equal(here, simulate_rf(points * [1, -1, 1], weights, ARRAY, 50e-3)[0])


def test_a_step_of_one_element_changes_nothing_but_the_place():
    rng = np.random.default_rng(4)
    points, weights = rng.uniform([-0.01, -0.004, 0.005], [0.01, 0.004, 0.08], (40, 3)), rng.normal(size=40)
    lines = np.array([-3.3e-3, 0.1e-3, 2e-3])
    here, there = (
        simulate_rf(points + [shift, 0, 0], weights, ARRAY, 50e-3, lines + shift)[0]
        for shift in (0.0, 7 * ARRAY.pitch)
    )
    n = min(len(here), len(there))
    assert correlation(here[:n], there[:n]) >= 0.9999


@pytest.mark.parametrize("fields", [{}, {"center_frequency": 2.5e6}, {"center_frequency": 5e6}])
def test_echo_has_the_centre_frequency(fields):
    array = LinearArray(**{**SMALL, **fields})
    rf, time = simulate_rf([(0, 0, 30e-3)], [1.0], array, 30e-3, [0.0])
    power = np.abs(np.fft.rfft(rf[:, 0])) ** 2
    centre = np.fft.rfftfreq(len(rf), time[1]) @ power / power.sum()
    assert centre == pytest.approx(array.center_frequency, rel=0.06)  # wide elements are a low pass


@pytest.mark.parametrize(
    "fields", [{"excitation_cycles": 1.0}, {"excitation_cycles": 5.0}, {"impulse_response_cycles": 3.5}]
)
def test_echo_lasts_as_long_as_the_pulse(fields):
    array = LinearArray(**SMALL, **fields)
    signals, time = envelope((0, 0, 60e-3), array, 60e-3)
    pulse = np.abs(signal.hilbert(np.pad(array.pulse, 200)))

    def duration(t, values):
        weight = values**2 / np.sum(values**2)
        return math.sqrt(t**2 @ weight - (t @ weight) ** 2)

    expected = duration(np.arange(len(pulse)) / array.sampling_frequency, pulse)
    assert duration(time, signals[:, 0]) == pytest.approx(expected, rel=0.08)
