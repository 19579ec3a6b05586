"""RF against an independent code, Field II, and against a closed form."""

import numpy as np
import pytest
from echoes import ARRAY, correlation, envelope, fitted, width

from usbench.envs import rf as rf_module
from usbench.envs.field.slow_sum import slow_rf
from usbench.envs.rf import simulate_rf

FOCI = (50e-3, 20e-3)  # of the reference


def frame(reference, k):
    """RF of the reference's scene, cut as the reference, and that of Field II, (n_samples, n_lines) each."""
    rf, _ = simulate_rf(reference["points"], reference["amplitudes"], ARRAY, FOCI[k], reference["x_lines"])
    expected = reference["rf_fst"][k].T.astype(float)
    return fitted(rf, len(expected)), expected


@pytest.fixture(scope="module")
def gain(reference):
    """The one factor between the units of both, from the frame at 50 mm."""
    rf, expected = frame(reference, 0)
    return float(np.vdot(expected, rf)) / float(np.vdot(expected, expected))


@pytest.mark.parametrize("k, whole, worst", [(0, 0.998, 0.98), (1, 0.996, 0.97)])
def test_frame_against_field_ii(reference_lines, k, whole, worst):
    rf, expected = frame(reference_lines, k)
    assert correlation(rf, expected) >= whole
    energy = np.square(expected).sum(axis=0)
    lines = np.flatnonzero(energy >= 0.01 * energy.mean())
    each = [correlation(rf[:, i], expected[:, i]) for i in lines]
    assert min(each) >= worst, f"line {lines[np.argmin(each)]}"


@pytest.mark.parametrize("k, bound", [(0, 0.998), (1, 0.996)])
def test_frame_against_the_closed_form(reference_lines, k, bound):
    rf, _ = frame(reference_lines, k)
    expected = reference_lines["rf_exact"][k].T.astype(float)
    assert correlation(rf[:, reference_lines["ref_lines"]], expected) >= bound


@pytest.mark.parametrize("few_pairs", [0, rf_module.FEW_PAIRS], ids=["table", "direct"])
@pytest.mark.parametrize("depth", range(6))
@pytest.mark.parametrize("k", range(2))
def test_single_points_against_field_ii(reference, gain, monkeypatch, k, depth, few_pairs):
    monkeypatch.setattr(rf_module, "FEW_PAIRS", few_pairs)
    expected = reference["pt_rf"][k, depth].astype(float)
    peaks = np.abs(expected).max(axis=-1)
    wrong = []
    for ix, iy in np.argwhere(peaks >= peaks.max() * 10 ** (-30 / 20)):
        point = reference["pt_x"][ix], reference["pt_y"][iy], reference["pt_z"][depth]
        rf, time = simulate_rf([point], [1.0], ARRAY, FOCI[k], [0.0])
        start = round(float(reference["pt_t0"][k, depth, ix, iy]) / (time[1] - time[0]))
        ours, theirs = fitted(rf[start:], expected.shape[-1])[:, 0], expected[ix, iy]
        error = 20 * np.log10(np.abs(ours).max() / gain / peaks[ix, iy] + 1e-9)
        if not (correlation(ours, theirs) >= 0.97 and abs(error) <= 1.0):
            wrong.append(f"{np.multiply(point, 1e3)} mm: {correlation(ours, theirs):.3f}, {error:+.1f} dB")
    assert not wrong, wrong


@pytest.mark.parametrize("k, depth", [(0, 0), (0, 1), (0, 2), (0, 3), (1, 0)])
@pytest.mark.parametrize("decibels", [-6.0, -20.0])
def test_width_of_a_point_against_field_ii(reference, k, depth, decibels):
    dx, z = reference["psf_dx"][::2], reference["psf_z"][depth]
    peaks = np.array([envelope((x, 0.0, z), focal_depth=FOCI[k])[0].max() for x in dx])
    expected = width(dx, reference["psf_lateral"][k, depth][::2], decibels)
    assert width(dx, peaks, decibels) == pytest.approx(expected, rel=0.05)


def test_the_slow_sum_against_field_ii(reference, gain):
    # Here, as everything below leans on it.
    for k, ix, iy, iz in [(0, 0, 0, 0), (0, 2, 1, 1), (1, 5, 2, 0), (1, 4, 1, 5)]:
        point = reference["pt_x"][ix], reference["pt_y"][iy], reference["pt_z"][iz]
        expected = reference["pt_rf"][k, iz, ix, iy].astype(float) * gain
        assert expected.any()
        time = reference["pt_t0"][k, iz, ix, iy] + np.arange(len(expected)) / 25e6
        rf = slow_rf([point], [1.0], ARRAY, FOCI[k], [0.0], time=time)[0][:, 0]
        assert correlation(rf, expected) >= 0.9995
        assert np.abs(rf).max() / np.abs(expected).max() == pytest.approx(1.0, rel=0.02)
