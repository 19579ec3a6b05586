"""The probes that come with the package: frames from tables of responses beside the direct sum."""

import numpy as np
import pytest
from echoes import correlation

from usbench import read_probe
from usbench.envs import rf as module
from usbench.envs.rf import simulate_rf

FOCUS = 30e-3
N_POINTS = 400


@pytest.mark.parametrize("name", ["l7-4", "l11-4v", "l12-5"])
def test_rf_of_points_on_and_off_the_plane_is_that_of_the_direct_sum(name):
    probe, rng = read_probe(name), np.random.default_rng(0)
    beside = probe.slice_thickness / 2
    points = rng.uniform((-0.012, -beside, 0.01), (0.012, beside, 0.045), (N_POINTS, 3))
    amplitudes = rng.normal(size=N_POINTS)
    lines = probe.line_positions[np.abs(probe.line_positions) <= 0.012]
    assert N_POINTS * len(lines) > module.FEW_PAIRS > N_POINTS
    rf, _ = simulate_rf(points, amplitudes, probe, FOCUS, lines)
    for k in (8, len(lines) // 2):
        one, _ = simulate_rf(points, amplitudes, probe, FOCUS, lines[k : k + 1])
        n = min(len(rf), len(one))
        assert correlation(rf[:n, k], one[:n, 0]) >= 0.99
