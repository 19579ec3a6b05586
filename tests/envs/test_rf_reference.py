"""RF against an independent code, Field II, and against a closed form."""

import exact
import numpy as np
import pytest
from echoes import ARRAY, correlation, envelope, fitted, width

from usbench.envs.rf import simulate_rf

FOCI = (50e-3, 20e-3)  # of the reference


@pytest.fixture(scope="module")
def frames(reference):
    """RF of the reference's scene for both focal depths, cut as the reference, (n_samples, n_lines) each."""
    scene = reference["points"], reference["amplitudes"]
    n = reference["rf_fst"].shape[-1]
    return [fitted(simulate_rf(*scene, ARRAY, focus, reference["x_lines"])[0], n) for focus in FOCI]


@pytest.fixture(scope="module")
def gain(reference, frames):
    """The one factor between the units of both, from the frame at 50 mm."""
    rf = reference["rf_fst"][0].T
    return float(np.vdot(rf, frames[0])) / float(np.vdot(rf, rf))


@pytest.mark.parametrize("k, whole, worst", [(0, 0.998, 0.98), (1, 0.996, 0.97)])
def test_frame_against_field_ii(reference, frames, k, whole, worst):
    expected = reference["rf_fst"][k].T
    assert correlation(frames[k], expected) >= whole
    energy = np.square(expected).sum(axis=0)
    lines = np.flatnonzero(energy >= 0.01 * energy.mean())
    each = [correlation(frames[k][:, i], expected[:, i]) for i in lines]
    assert min(each) >= worst, f"line {lines[np.argmin(each)]}"


@pytest.mark.parametrize("k, bound", [(0, 0.998), (1, 0.996)])
def test_frame_against_the_closed_form(reference, frames, k, bound):
    assert correlation(frames[k][:, reference["ref_lines"]], reference["rf_exact"][k].T) >= bound


@pytest.mark.parametrize("depth", range(6))
@pytest.mark.parametrize("k", range(2))
def test_single_points_against_field_ii(reference, gain, k, depth):
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


def test_the_exact_model_of_these_tests_against_field_ii(reference, gain):
    # Here, as everything below leans on it.
    for k, ix, iy, iz in [(0, 0, 0, 0), (0, 2, 1, 1), (1, 5, 2, 0), (1, 4, 1, 5)]:
        point = reference["pt_x"][ix], reference["pt_y"][iy], reference["pt_z"][iz]
        time = reference["pt_t0"][k, iz, ix, iy] + np.arange(1600) / 25e6
        rf = exact.rf([point], [1.0], ARRAY, FOCI[k], [0.0], time)[:, 0]
        expected = reference["pt_rf"][k, iz, ix, iy] * gain
        assert correlation(rf, expected) >= 0.9995
        assert np.abs(rf).max() / np.abs(expected).max() == pytest.approx(1.0, rel=0.02)
