"""The slow sum against closed forms: one element, the focus, and the times of the samples."""

import re
from pathlib import Path

import numpy as np
import pytest
from echoes import SMALL

from usbench.envs.field.slow_sum import one_way, slow_rf
from usbench.envs.probe import LinearArray
from usbench.envs.rf import simulate_rf

ROOT = Path(__file__).parents[3]
FREQUENCIES = np.linspace(2e6, 5e6, 7)


def test_a_small_element_sends_a_spherical_wave():
    # Area over 2 pi r, later by r / c (Rayleigh's integral), and weaker by the attenuation on the way r.
    array = LinearArray(n_elements=1, n_active=1, element_width=1e-5, element_height=1e-5)
    r = np.hypot(4e-3, 30e-3)
    for attenuation in (0.0, 0.6):
        spectrum = one_way((4e-3, 0.0, 30e-3), array, 30e-3, 0.0, FREQUENCIES, attenuation)
        loss = 10 ** (-attenuation * (r * 1e2) * (FREQUENCIES / 1e6) / 20)
        expected = 1e-10 / (2 * np.pi * r) * loss * np.exp(-2j * np.pi * FREQUENCIES * r / 1540)
        assert np.abs(spectrum / expected - 1).max() <= 1e-3


def test_waves_of_all_elements_meet_at_the_focus():
    array = LinearArray(n_elevation=1, element_height=1e-6)
    spectrum = one_way((1e-3, 0.0, 50e-3), array, 50e-3, 1e-3, FREQUENCIES)
    assert np.angle(spectrum * np.exp(2j * np.pi * FREQUENCIES * 50e-3 / 1540)) == pytest.approx(0, abs=1e-6)


def test_shapes_are_those_of_the_fast_engine_and_the_last_echo_is_whole():
    array, lines = LinearArray(**SMALL), [-1e-3, 2e-3, 3e-3]
    scene = [(2e-3, 0.0, 20e-3), (-5e-3, 1e-3, 40e-3)], [1.0, -2.0]
    rf, time = slow_rf(*scene, array, 30e-3, lines)
    fast, fast_time = simulate_rf(*scene, array, 30e-3, lines)
    n = min(len(time), len(fast_time))
    assert rf.shape == (len(time), 3) and time[:n] == pytest.approx(fast_time[:n])
    longer = slow_rf(*scene, array, 30e-3, lines, time=np.arange(2 * len(time)) * time[1])[0]
    assert np.abs(longer[len(time) :]).max() <= 1e-5 * np.abs(longer).max()
    assert np.abs(longer[: len(time)] - rf).max() <= 1e-12 * np.abs(rf).max()


def test_nothing_there_is_silence():
    rf, time = slow_rf([], [], LinearArray(**SMALL, n_lines=3), 30e-3)
    assert rf.shape == (len(time), 3) and not rf.any()


def test_every_scatterer_has_an_amplitude():
    with pytest.raises(ValueError, match="argument 2 is shorter"):
        slow_rf([(0, 0, 0.02), (0, 0, 0.03)], [1.0], LinearArray(**SMALL), 30e-3, [0.0])


def test_the_docs_show_the_code_as_it_is_but_for_where_lines_break():
    code = without_space((ROOT / "envs" / "field" / "slow_sum.py").read_text())
    shown = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "physics.md").read_text(), re.DOTALL)
    assert len(shown) >= 8
    for excerpt in shown:
        assert without_space(excerpt) in code, excerpt


def without_space(text):
    return "".join(text.split())
