"""The direct sum against the slow sum, and against the table of responses where it takes over."""

import numpy as np
import pytest

from usbench.envs import rf as module
from usbench.envs.field.slow_sum import slow_rf
from usbench.envs.probe import LinearArray
from usbench.envs.rf import simulate_iq, simulate_rf

L7 = LinearArray(
    center_frequency=7e6, n_elements=128, element_width=0.27e-3, kerf=0.03e-3, n_active=64, n_lines=128,
    line_spacing=0.3e-3,
)  # fmt: skip
POINTS = np.array(
    [[-17e-3, 0.0, 30e-3], [-4e-3, 3.5e-3, 12e-3], [0.5e-3, -1e-3, 30e-3], [16e-3, 2e-3, 45e-3]]
)
AMPLITUDES = np.array([1.0, 0.5, -1.0, 2.0])


def correlation(one, other):
    n = min(len(one), len(other))
    return np.vdot(one[:n], other[:n]).real / np.linalg.norm(one[:n]) / np.linalg.norm(other[:n])


@pytest.mark.parametrize("attenuation", [0.0, 0.5])
@pytest.mark.parametrize("focal_depth", [8e-3, 30e-3])
def test_against_the_slow_sum_beyond_the_last_full_aperture(focal_depth, attenuation):
    lines = L7.line_positions[[0, 3, 31, 64, 100, 127]]
    scene = POINTS, AMPLITUDES, L7, focal_depth, lines, attenuation
    fast, time = simulate_rf(*scene)
    slow = slow_rf(*scene, time=time)[0]
    assert correlation(fast, slow) >= 0.999
    assert np.linalg.norm(fast) == pytest.approx(np.linalg.norm(slow), rel=0.01)


def test_many_points_add_up():
    # More than are summed at a time.
    rng = np.random.default_rng(1)
    points = rng.uniform([-0.01, -3e-3, 0.01], [0.01, 3e-3, 0.05], (200, 3))
    amplitudes = np.repeat([1.0, -2.0], 100)
    scene = L7, 30e-3, L7.line_positions[[40, 64]]
    whole, halves = (
        sum(simulate_iq(points[part], amplitudes[part], *scene, 0.06)[0] for part in parts)
        for parts in ([slice(None)], [slice(100), slice(100, None)])
    )
    assert np.abs(whole - halves).max() <= 1e-5 * np.abs(whole).max()


@pytest.mark.parametrize("n_active", [1, 3, 7])
def test_against_the_slow_sum_with_few_active_elements(n_active):
    array = LinearArray(n_elements=24, n_active=n_active)
    scene = POINTS, AMPLITUDES, array, 20e-3, [-6e-3, -0.2e-3, 1.1e-3, 5.9e-3]
    fast, time = simulate_rf(*scene)
    assert correlation(fast, slow_rf(*scene, time=time)[0]) >= 0.999


# As accurate as the table is with scattered points (docs/physics.md).
@pytest.mark.parametrize(("focal_depth", "least"), [(10e-3, 0.985), (50e-3, 0.995)])
def test_the_table_takes_over_without_a_jump(monkeypatch, focal_depth, least):
    rng = np.random.default_rng(0)
    array = LinearArray()
    points = np.stack(
        [rng.uniform(low, high, 60) for low, high in ((-0.02, 0.02), (-5e-3, 5e-3), (5e-3, 0.08))]
    )
    scene = points.T, rng.normal(size=60), array, focal_depth, array.line_positions[::2]
    direct = simulate_iq(*scene)[0]
    assert module.FEW_PAIRS > 60 * 32
    monkeypatch.setattr(module, "FEW_PAIRS", 60 * 32 - 1)
    table = simulate_iq(*scene)[0]
    assert not np.array_equal(direct, table) and correlation(direct, table) >= least
    assert np.linalg.norm(direct) == pytest.approx(np.linalg.norm(table), rel=0.01)


def test_the_number_of_threads_changes_no_bit(monkeypatch):
    points = np.random.default_rng(1).uniform(0.01, 0.03, (70, 3))  # more than are taken at a time
    found = set()
    for n in (1, 2, 3, 5):
        monkeypatch.setenv("USBENCH_THREADS", str(n))
        found.add(simulate_iq(points, np.ones(70), L7, 30e-3, L7.line_positions[:9])[0].tobytes())
    assert len(found) == 1


def test_echoes_that_end_beyond_the_record_are_cut_off():
    whole = simulate_iq(POINTS, AMPLITUDES, L7, 30e-3)[0]
    cut = simulate_iq(POINTS, AMPLITUDES, L7, 30e-3, max_depth=31e-3)[0]
    assert len(cut) < len(whole) and np.array_equal(cut, whole[: len(cut)])


def test_a_point_at_the_surface_is_heard_from_time_zero():
    scene = [(0.0, 0.0, 1e-4)], [1.0], LinearArray(n_active=1, n_elements=3), 10e-3, [0.0]
    fast, time = simulate_rf(*scene)
    assert correlation(fast, slow_rf(*scene, time=time)[0]) >= 0.999
