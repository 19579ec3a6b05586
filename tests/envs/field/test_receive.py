"""Receive focusing apart from the transmit: the engine against the slow sum, and both against theory."""

from dataclasses import replace

import numpy as np
import pytest
from beside_the_line import KINDS as BESIDE
from beside_the_line import single_points, worst
from echoes import SMALL, correlation, envelope, width

from usbench.envs import rf as module
from usbench.envs.field.response_table import forget_tables
from usbench.envs.field.slow_sum import one_way, slow_rf
from usbench.envs.probe import LinearArray
from usbench.envs.rf import simulate_iq, simulate_rf

ARRAY = LinearArray(**SMALL)
POINTS = np.array([[0.4e-3, 0.0, 15e-3], [-3e-3, 2e-3, 30e-3], [2.2e-3, -1e-3, 45e-3]])
LINES = np.array([-2.9e-3, 0.1e-3, 2.3e-3])
KINDS = [
    {"receive_focus": 40e-3},
    {"receive_focus": "dynamic"},
    {"receive_focus": "dynamic", "receive_f_number": 2.5},
    {"receive_f_number": 3},
]
OF_KINDS = pytest.mark.parametrize("receive", KINDS, ids=str)


@OF_KINDS
@pytest.mark.parametrize("n_pairs", [0, module.FEW_PAIRS], ids=["table", "direct"])
def test_against_the_slow_sum(monkeypatch, receive, n_pairs):
    monkeypatch.setattr(module, "FEW_PAIRS", n_pairs)
    array = replace(ARRAY, **receive)
    # All points together, and one alone beside the line's axis.
    for points, lines in ((POINTS, LINES), (POINTS[:1], LINES[1:2])):
        scene = points, np.ones(len(points)), array, 25e-3, lines
        fast, time = simulate_rf(*scene)
        slow = slow_rf(*scene, time=time)[0]
        assert correlation(fast, slow) >= 0.995
        assert np.linalg.norm(fast) == pytest.approx(np.linalg.norm(slow), rel=0.03)


def test_beyond_the_last_full_aperture_the_direct_sum_hears_them_too():
    array = replace(ARRAY, receive_focus="dynamic", receive_f_number=2)
    scene = POINTS + [19e-3, 0, 0], np.ones(3), array, 25e-3, [20e-3]
    fast, time = simulate_rf(*scene)
    assert correlation(fast, slow_rf(*scene, time=time)[0]) >= 0.999


def test_the_focal_depth_as_receive_focus_is_the_same_as_none():
    scene = POINTS, np.ones(3)
    for n_pairs in (0, 2048):
        with pytest.MonkeyPatch.context() as monkeypatch:
            monkeypatch.setattr(module, "FEW_PAIRS", n_pairs)
            none = simulate_iq(*scene, ARRAY, 25e-3, LINES)[0]
            same = simulate_iq(*scene, replace(ARRAY, receive_focus=25e-3), 25e-3, LINES)[0]
        assert np.abs(none - same).max() <= 2e-3 * np.abs(none).max()


@pytest.mark.parametrize("depth", [15e-3, 50e-3])
def test_dynamic_focusing_narrows_points_away_from_the_transmit_focus(depth):
    x = np.linspace(0, 3e-3, 61)
    profiles = [
        envelope((0.0, 0.0, depth), replace(ARRAY, receive_focus=focus), 25e-3, x)[0].max(axis=0)
        for focus in (None, "dynamic")
    ]
    fixed, dynamic = (width(x, profile) for profile in profiles)
    assert dynamic <= 0.8 * fixed
    assert profiles[1][0] > profiles[0][0]  # all elements in phase


@pytest.mark.parametrize("f_number", [2.0, 3.0, 4.0])
def test_the_receive_beam_is_two_wavelengths_times_the_f_number_wide(f_number):
    # The transform of a Hann window of the width W falls to a half at 1 / W: 2 lambda z / W at the focus.
    array = LinearArray(receive_focus="dynamic", receive_f_number=f_number)
    for depth in (30e-3, 50e-3):
        x = np.linspace(0, 4 * f_number * array.wavelength, 81)
        frequency = np.array([array.center_frequency])
        beam = [
            np.abs(
                one_way(
                    (u, 0.0, depth), replace(array, receive_focus=depth), 20e-3, 0.0, frequency, receive=True
                )
            )
            for u in x
        ]
        found = width(x, np.concatenate(beam))
        assert found == pytest.approx(2 * array.wavelength * f_number, rel=0.08)


def test_at_its_transmit_focus_a_dynamic_receive_changes_nothing():
    point = [(0.0, 0.0, 25e-3)]
    fixed, dynamic = (
        simulate_iq(point, [1.0], replace(ARRAY, receive_focus=focus), 25e-3, [0.0])[0]
        for focus in (None, "dynamic")
    )
    assert np.abs(fixed - dynamic).max() <= 1e-4 * np.abs(fixed).max()


@OF_KINDS
def test_the_number_of_threads_changes_no_bit(monkeypatch, receive):
    monkeypatch.setattr(module, "FEW_PAIRS", 0)
    found = set()
    for n in (1, 3):
        monkeypatch.setenv("USBENCH_THREADS", str(n))
        forget_tables()
        found.add(simulate_iq(POINTS, np.ones(3), replace(ARRAY, **receive), 25e-3, LINES)[0].tobytes())
    assert len(found) == 1


# What docs/physics.md says of single points beside the line: least correlation and largest error in dB.
@pytest.mark.parametrize(
    ("name", "near", "far"),
    [
        ("as the transmit", (0.994, 0.4), (0.994, 1.05)),
        ("80 mm", (0.993, 0.4), (0.99, 0.8)),
        ("dynamic", (0.99, 0.75), (0.92, 4.5)),
        ("dynamic, f/2", (0.98, 0.6), (0.91, 2.5)),
    ],
)
def test_single_points_beside_the_line_are_as_exact_as_the_docs_say(name, near, far):
    found = single_points(BESIDE[name])
    for (least, largest), limits in ((near, (0, -20)), (far, (-20, -30))):
        alike, error_db = worst(found, *limits)
        assert alike >= least and error_db <= largest
