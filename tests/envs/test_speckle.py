"""Speckle of tissue without structure: its statistics are known, whatever the transducer.

Wagner, Smith, Sandrik and Lopez, "Statistics of speckle in ultrasound B-scans", IEEE T-SU 30 (1983).
"""

import math

import numpy as np
import pytest

from usbench.envs.bmode import envelope, log_compress
from usbench.envs.probe import LinearArray
from usbench.envs.rf import simulate_iq, simulate_rf

ARRAY = LinearArray()
FOCUS = 50e-3
LINES = np.arange(-54, 55) / 3e3  # three in a beam's width of 1 mm


def tissue(n, seed=0):
    """Positions (n, 3) and amplitudes (n,) of structureless tissue around the focus."""
    rng = np.random.default_rng(seed)
    low, high = [-21e-3, -4e-3, FOCUS - 14e-3], [21e-3, 4e-3, FOCUS + 14e-3]
    return rng.uniform(low, high, (n, 3)), rng.normal(size=n)


def middle(signals, time):
    """The samples within 11 mm of the focus, each depth as loud as all others."""
    depth = (time - ARRAY.pulse_delay) * ARRAY.speed_of_sound / 2
    signals = signals[np.abs(depth - FOCUS) <= 11e-3]
    return signals / np.sqrt(np.mean(np.abs(signals) ** 2, axis=1, keepdims=True))


@pytest.fixture(scope="module")
def dense():
    """RF, (n_samples, n_lines), and time of some 20 scatterers in every resolution cell."""
    return simulate_rf(*tissue(60_000), ARRAY, FOCUS, LINES)


@pytest.fixture(scope="module")
def speckle():
    """The same as I/Q, around the focus."""
    return middle(*simulate_iq(*tissue(60_000), ARRAY, FOCUS, LINES))


def test_envelope_of_dense_tissue_is_rayleigh_distributed(dense):
    rf, time = dense
    amplitudes = middle(envelope(rf), time)
    # Some 1 000 independent samples.
    assert amplitudes.mean() / amplitudes.std() == pytest.approx(math.sqrt(math.pi / (4 - math.pi)), abs=0.08)
    for level in (0.25, 0.5, 1.0, 1.5, 2.0):
        assert np.mean(amplitudes > level) == pytest.approx(math.exp(-(level**2)), abs=0.03)


def test_decibels_of_dense_tissue_have_the_spread_of_log_rayleigh(dense):
    rf, time = dense
    amplitudes = middle(envelope(rf), time)
    decibels = log_compress(amplitudes.astype(np.float32), 60.0)
    # 20 / ln 10 of the standard deviation pi / sqrt(24) of the logarithm.
    expected = 20 / math.log(10) * math.pi / math.sqrt(24)
    assert decibels.std() == pytest.approx(expected, rel=0.08)


def test_phase_of_dense_tissue_is_uniform(speckle):
    phases = speckle / np.abs(speckle)
    for order in (1, 2):
        assert abs(np.mean(phases**order)) <= 0.1


def test_neighbouring_lines_are_as_alike_as_their_beams_overlap(speckle):
    # Van Cittert-Zernike: the correlation of speckle is that of the response to a point.
    x = np.arange(-60, 61) / 12e3
    points = np.stack([x, 0 * x, FOCUS + 0 * x], axis=1)
    responses = [simulate_iq([point], [1.0], ARRAY, FOCUS, [0.0])[0][:, 0] for point in points]
    n = min(map(len, responses))
    response = np.array([values[:n] for values in responses])

    def correlation(a, b):
        return abs(np.vdot(a, b)) / float(np.linalg.norm(a)) / float(np.linalg.norm(b))

    for step in (1, 2, 3, 6):
        expected = correlation(response[4 * step :], response[: -4 * step])
        assert correlation(speckle[:, step:], speckle[:, :-step]) == pytest.approx(expected, abs=0.08)


def test_sparse_tissue_is_not_rayleigh_distributed():
    # One scatterer in several cells: its echoes stand alone.
    rf, time = simulate_rf(*tissue(600), ARRAY, FOCUS, LINES)
    amplitudes = envelope(rf)[np.abs((time - ARRAY.pulse_delay) * ARRAY.speed_of_sound / 2 - FOCUS) <= 11e-3]
    assert amplitudes.mean() / amplitudes.std() <= 1.4


def test_echoes_grow_with_the_root_of_the_density_and_with_the_amplitude(dense):
    rf, time = dense
    fewer, fewer_time = simulate_rf(*tissue(15_000, seed=1), ARRAY, FOCUS, LINES)

    def loudness(signals, times):
        depth = (times - ARRAY.pulse_delay) * ARRAY.speed_of_sound / 2
        return math.sqrt(np.mean(np.square(signals[np.abs(depth - FOCUS) <= 11e-3])))

    assert loudness(rf, time) / loudness(fewer, fewer_time) == pytest.approx(2.0, rel=0.1)
