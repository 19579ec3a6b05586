"""RF against two independent codes, against theory and, where it gives no number, the exact model."""

import hashlib
import math
import multiprocessing

import exact
import numpy as np
import pytest
from scipy import signal

from usbench.envs import elevation, response
from usbench.envs.probe import LinearArray
from usbench.envs.rf import simulate_iq, simulate_rf

ARRAY = LinearArray()
SMALL = {"n_elements": 96, "n_active": 24}  # its tables are made in a fraction of a second
FOCI = (50e-3, 20e-3)  # of the reference


def correlation(a, b):
    """Normalised correlation of everything in two arrays, 0 if one is silent."""
    norm = math.sqrt(float(np.vdot(a, a)) * float(np.vdot(b, b)))
    return float(np.vdot(a, b)) / norm if norm else 0.0


def fitted(rf, n):
    """The first n samples, with zeros where `rf` has ended."""
    return np.pad(rf[:n].astype(float), ((0, max(0, n - len(rf))), (0, 0)))


def envelope(point, array=ARRAY, focal_depth=50e-3, lines=(0.0,)):
    """Envelope (n_samples, n_lines) of one point, and its time."""
    iq, time = simulate_iq([point], [1.0], array, focal_depth, lines)
    return np.abs(iq), time


def width(x, profile, decibels=-6.0):
    """Full width of a peak at x = 0 seen from its right side, out to the last crossing of the level."""
    level = profile.max() * 10 ** (decibels / 20)
    last = np.flatnonzero(profile >= level)[-1]
    return 2 * float(np.interp(-level, -profile[last : last + 2], x[last : last + 2]))


# Against the reference


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


# Against theory


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


def test_beam_is_narrowest_at_its_focus():
    lines = np.arange(0, 41) * 0.1e-3
    widths = [
        width(lines, envelope((0, 0, z), focal_depth=50e-3, lines=lines)[0].max(axis=0))
        for z in (35e-3, 50e-3, 70e-3)
    ]
    assert widths[1] == pytest.approx(1.05e-3, rel=0.05)  # the reference's
    assert widths[1] < widths[0] / 2 and widths[1] < widths[2] / 2


@pytest.mark.parametrize(
    "fields",
    [
        {},
        {"n_active": 16},
        {"center_frequency": 5e6},
        {"element_width": 0.3e-3},
        {"kerf": 0.15e-3},
    ],
)
def test_width_at_the_focus_is_wavelength_times_depth_over_aperture(fields):
    # -3 dB of a Hann window's transform, as it is heard twice: 1.44 bins (Harris 1978, table 1).
    array = LinearArray(**{**SMALL, **fields})
    lines = np.arange(0, 61) * array.pitch / 6
    profile = envelope((0, 0, 30e-3), array, 30e-3, lines)[0].max(axis=0)
    expected = 1.44 * array.wavelength * 30e-3 / ((array.n_active + 1) * array.pitch)
    assert width(lines, profile) == pytest.approx(expected, rel=0.12)


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


def test_a_wide_pitch_has_a_grating_lobe_where_theory_puts_it():
    array = LinearArray(**SMALL, element_width=0.5e-3, kerf=0.4e-3, excitation_cycles=8.0)
    angles = np.radians(np.arange(16.0, 45.0))
    points = 40e-3 * np.column_stack([np.sin(angles), 0 * angles, np.cos(angles)])
    peaks = [envelope(point, array, 40e-3)[0].max() for point in points]
    lobe = math.asin(array.wavelength / array.pitch)  # first order, 29 degrees
    assert angles[np.argmax(peaks)] == pytest.approx(lobe, abs=math.radians(2))


@pytest.mark.parametrize("height", [3e-3, 8e-3])
def test_taller_elements_hear_a_thinner_slice(height):
    array = LinearArray(**SMALL, element_height=height)
    points = [(0, y, 85e-3) for y in (0, 2e-3)]
    centre, beside = (envelope(point, array, 85e-3)[0].max() for point in points)
    expected = np.sinc(height * 2e-3 / (array.wavelength * 85e-3)) ** 2  # far field, there and back
    assert beside / centre == pytest.approx(expected, abs=0.12)


def test_the_nearest_line_hears_a_point_best():
    array = LinearArray(**SMALL, n_lines=21, line_spacing=1e-3)
    signals, _ = envelope((4.2e-3, 0, 30e-3), array, 30e-3, lines=None)
    assert signals.shape[1] == 21 and signals.max(axis=0).argmax() == 14  # at 4 mm
    chosen, _ = envelope((4.2e-3, 0, 30e-3), array, 30e-3, array.line_positions[[3, 14]])
    n = min(len(chosen), len(signals))
    assert chosen[:n] == pytest.approx(signals[:n, [3, 14]], abs=1e-4 * float(signals.max()))


def test_amplitude_of_dense_speckle_is_rayleigh_distributed():
    rng = np.random.default_rng(5)
    n = 80_000  # some 30 in every resolution cell
    points = rng.uniform([-0.022, -0.004, 0.035], [0.022, 0.004, 0.065], (n, 3))
    iq, time = simulate_iq(points, rng.choice([-1.0, 1.0], n), ARRAY, 50e-3, np.arange(-18, 19) * 1e-3)
    rows = np.abs(time - ARRAY.pulse_delay - 2 * 50e-3 / 1540) <= 2 * 12e-3 / 1540
    amplitude = np.abs(iq[rows])
    amplitude = amplitude / np.sqrt(np.mean(amplitude**2, axis=1, keepdims=True))
    # 37 lines of 1 mm and 24 mm of depth: 0.026 for one sigma, as other seeds show.
    assert amplitude.mean() / amplitude.std() == pytest.approx(math.sqrt(math.pi / (4 - math.pi)), abs=0.08)
    for level in (0.5, 1.0, 1.5):
        assert np.mean(amplitude > level) == pytest.approx(math.exp(-(level**2)), abs=0.03)


# Against the exact model: other arrays, focal depths, lines and places

CLOUD = np.random.default_rng(6).uniform([-0.012, -0.0025, 0.015], [0.012, 0.0025, 0.07], (14, 3))
WEIGHTS = np.random.default_rng(7).normal(size=14)
LINES = np.array([-4.1e-3, 6.33e-3])


def check(array, focal_depth, lines=LINES, points=CLOUD, weights=WEIGHTS, bound=0.98):
    """RF against the exact model: correlation, and size within 1 dB."""
    rf, time = simulate_rf(points, weights, array, focal_depth, lines)
    expected = exact.rf(points, weights, array, focal_depth, lines, time)
    assert correlation(rf, expected) >= bound
    assert np.linalg.norm(rf) / np.linalg.norm(expected) == pytest.approx(1.0, rel=0.12)


@pytest.mark.parametrize(
    "fields",
    [
        {"center_frequency": 2.5e6},
        {"center_frequency": 6e6},
        {"sampling_frequency": 50e6},
        {"speed_of_sound": 1450.0},
        {"element_width": 0.8e-3},
        {"kerf": 0.2e-3},
        {"n_active": 17},
        {"n_elements": 60},
        {"element_height": 8e-3},
        {"excitation_cycles": 1.3},
        {"impulse_response_cycles": 3.0},
        {"n_elevation": 1},
        {"n_elevation": 16},
    ],
    ids=str,
)
def test_every_field_of_the_array_counts(fields):
    check(LinearArray(**{**SMALL, **fields}), 40e-3)


@pytest.mark.parametrize("focal_depth", [5e-3, 7.7e-3, 90e-3, 0.2])
def test_any_focal_depth(focal_depth):
    check(LinearArray(**SMALL), focal_depth)


@pytest.mark.parametrize("focal_depth", [5e-3, 10e-3])
def test_short_foci_of_the_whole_aperture(focal_depth):
    # Delays between neighbours exceed half a wavelength, hence grating lobes of several orders at once.
    rng = np.random.default_rng(8)
    points = rng.uniform([-0.02, -0.0025, 0.004], [0.02, 0.0025, 0.09], (30, 3))
    check(ARRAY, focal_depth, np.array([-1.25e-3, 6.5e-3]), points, rng.normal(size=30), bound=0.95)


def test_an_array_of_very_wide_elements_has_many_lobes():
    # A pitch of 5 wavelengths: more orders than lobes of an ordinary array.
    array = LinearArray(element_width=2.1e-3, kerf=0.1e-3, n_elements=32, n_active=16)
    check(array, 20e-3, bound=0.95)


def test_lines_beyond_the_end_of_the_array():
    array = LinearArray(**SMALL)  # 47 mm wide: the aperture's centre stays within 17.6 mm
    check(array, 40e-3, np.array([3e-3, 19e-3]), CLOUD + [8e-3, 0, 0])


def test_nothing_but_lines_beyond_the_end_of_the_array():
    check(LinearArray(**SMALL), 40e-3, np.array([18.5e-3]), CLOUD + [8e-3, 0, 0])


def test_scatterers_far_off():
    array = LinearArray(n_elements=240, n_active=16)
    points = CLOUD * [1, 1, 1.5] + [33e-3, 0, 0]  # to 45 mm from the centre, and to 105 mm of depth
    check(array, 80e-3, np.array([28e-3, 36.1e-3]), points)


def test_rf_lasts_until_the_latest_echo():
    # Far to the side of a short focus, the far end of the aperture hears it late.
    array, point = LinearArray(), [(15e-3, 0.0, 50e-3)]
    rf, time = simulate_rf(point, [1.0], array, 20e-3, [0.0])
    long = np.arange(2 * len(time)) * (time[1] - time[0])
    expected = exact.rf(point, [1.0], array, 20e-3, [0.0], long)
    assert np.sum(expected[len(time) :] ** 2) <= 1e-3 * np.sum(expected**2)


# The same bits, whoever computes them


def _digest():
    response.response_table.cache_clear()
    elevation.elevation_taps.cache_clear()
    array = LinearArray(**SMALL)
    iq, _ = simulate_iq(CLOUD, WEIGHTS, array, 35e-3, np.arange(-7, 8) * 1.3e-3)
    return hashlib.sha256(iq.tobytes()).hexdigest()


def test_same_bits_for_any_number_of_threads(monkeypatch):
    digests = set()
    for n in ("1", "2", "3"):
        monkeypatch.setenv("USBENCH_THREADS", n)
        digests.add(_digest())
    assert len(digests) == 1


@pytest.mark.parametrize("text", ["0", "-1", "two", "1.5"])
def test_refuses_a_number_of_threads(monkeypatch, text):
    monkeypatch.setenv("USBENCH_THREADS", text)
    with pytest.raises(ValueError, match=f"USBENCH_THREADS must be a whole number from 1, not '{text}'"):
        _digest()


@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
@pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="no fork on this platform")
def test_a_forked_child_computes_the_same():
    here = _digest()
    with multiprocessing.get_context("fork").Pool(1) as pool:
        assert pool.apply_async(_digest).get(timeout=60) == here


# Bad input


def test_nothing_there_is_silence():
    rf, time = simulate_rf(np.empty((0, 3)), np.empty(0), ARRAY, 50e-3)
    assert rf.shape == (len(time), 64) and not rf.any()
    assert simulate_rf([], [], ARRAY, 50e-3)[0].shape[1] == 64


def test_a_silent_scatterer_is_silence():
    assert not simulate_rf([(0, 0, 50e-3)], [0.0], ARRAY, 50e-3)[0].any()


@pytest.mark.parametrize("depth", [0.0, -1e-3])
def test_refuses_scatterers_not_below_the_surface(depth):
    with pytest.raises(ValueError, match=r"^scatterers must lie below the surface \(z > 0\), not at z = "):
        simulate_rf([(0, 0, 50e-3), (0, 0, depth)], [1.0, 1.0], ARRAY, 50e-3)


@pytest.mark.parametrize("depth", [1e-6, 0.1e-3, 0.6e-3])
def test_scatterers_just_below_the_surface_are_harmless(depth):
    rf, _ = simulate_rf([(0, 0, depth)], [1.0], LinearArray(**SMALL), 50e-3, [0.0])
    assert np.isfinite(rf).all()


@pytest.mark.parametrize("focal_depth", [0, -0.01, math.nan, math.inf, 0.51])
def test_refuses_focal_depths(focal_depth):
    with pytest.raises(ValueError, match=rf"^focal_depth must be in \(0, 0.5\] m, not {focal_depth}\.$"):
        simulate_rf([(0, 0, 50e-3)], [1.0], ARRAY, focal_depth)


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_refuses_values_that_are_not_finite(value):
    for positions, amplitudes, lines, name in [
        ([(value, 0, 50e-3)], [1.0], [0.0], "positions"),
        ([(0, 0, 50e-3)], [value], [0.0], "amplitudes"),
        ([(0, 0, 50e-3)], [1.0], [value], "line_positions"),
    ]:
        with pytest.raises(ValueError, match=f"^{name} must be finite"):
            simulate_rf(positions, amplitudes, ARRAY, 50e-3, lines)


@pytest.mark.parametrize(
    "positions, amplitudes, lines, words",
    [
        ([(0, 0.05)], [1.0], [0.0], r"positions must have shape \(n, 3\), not \(1, 2\)"),
        ([0, 0, 0.05], [1.0], [0.0], r"positions must have shape \(n, 3\), not \(3,\)"),
        ([(0, 0, 0.05)], [1.0, 2.0], [0.0], r"amplitudes must have shape \(1,\)"),
        ([(0, 0, 0.05)], 1.0, [0.0], r"amplitudes must have shape \(1,\)"),
        ([(0, 0, 0.05)], [1.0], [], r"line_positions must have shape \(n_lines,\)"),
        ([(0, 0, 0.05)], [1.0], [[0.0]], r"line_positions must have shape \(n_lines,\)"),
        ([(0, 0, 50.0)], [1.0], [0.0], r"positions must be within 0.5 m, not 50 m"),
        ([(0, 0, 0.05)], [1.0], [2.0], r"line_positions must be within 0.5 m, not 2 m"),
    ],
)
def test_refuses_shapes_and_units(positions, amplitudes, lines, words):
    with pytest.raises(ValueError, match=words):
        simulate_rf(positions, amplitudes, ARRAY, 50e-3, lines)
