"""The image chain on signals whose envelope is known, on the reference and on real data."""

import math
import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from usbench.envs.bmode import MOST_MEDIAN, Imaging, bmode, envelope, log_compress, simulated_bmode
from usbench.envs.probe import LinearArray
from usbench.envs.rf import simulate_rf

REFERENCE = Path(__file__).parents[1] / "reference"
FS, F0, C = 25e6, 3.5e6, 1540.0
LINES = (np.arange(64) - 31.5) * 0.625e-3
PLAIN = Imaging(median_size=1)


def burst(depth=50e-3, extent=20e-3, n=3200):
    """A tone with a Gaussian envelope around `depth`, as RF and as I/Q (n, 64), and its depths (n,)."""
    time = np.arange(n) / FS
    z = time * C / 2
    amplitude = np.exp(-(((z - depth) / extent) ** 2))
    rf = amplitude * np.cos(2 * np.pi * F0 * time + 0.3)
    return np.tile(rf[:, np.newaxis], 64), np.tile(amplitude[:, np.newaxis] * np.exp(0.4j), 64), z


def expected_column(depth=50e-3, extent=20e-3, dynamic_range=60.0):
    """Pixels of the burst: 20 log10 of the Gaussian at the centres of 90 pixels."""
    decibels = 20 * np.log10(np.exp(-((((np.arange(90) + 0.5) * 1e-3 - depth) / extent) ** 2)))
    return 255 / dynamic_range * np.maximum(dynamic_range + decibels, 0)


def test_envelope_of_a_tone_is_its_amplitude():
    rf, iq, z = burst()
    inner = slice(200, -200)
    expected = np.exp(-(((z - 50e-3) / 20e-3) ** 2))
    assert envelope(rf)[inner, 3] == pytest.approx(expected[inner], abs=0.01)
    assert envelope(iq)[:, 3] == pytest.approx(expected, abs=1e-6)


def test_envelope_of_an_echo_at_the_end_is_nothing_at_the_start():
    """The transform is periodic, a record is not."""
    signals = np.zeros((1024, 1))
    signals[-64:, 0] = np.cos(0.2 * np.pi * np.arange(64))
    found = envelope(signals)
    assert found[:20].max() < 1e-2 * found.max()


@pytest.mark.parametrize("kind", [0, 1], ids=["rf", "iq"])
def test_decibels_of_a_known_burst(kind):
    image = bmode(burst()[kind], FS, LINES, imaging=PLAIN)
    assert image.shape == (90, 40) and image.dtype == np.uint8
    inner = slice(4, 86)  # the Hilbert transform of a cut signal is wrong at its ends
    assert image[inner, 20].astype(float) == pytest.approx(expected_column()[inner], abs=2)
    assert (image == image[:, :1]).all()


def test_time_zero_moves_the_image():
    _, iq, _ = burst()
    cut = 260
    late = bmode(iq[cut:], FS, LINES, time_zero=cut / FS, imaging=PLAIN)
    assert late[10:, 20].astype(float) == pytest.approx(expected_column()[10:], abs=2)
    early = bmode(iq, FS, LINES, time_zero=-2 * 10e-3 / C, imaging=PLAIN)  # 10 mm nearer
    assert early[2:70, 20].astype(float) == pytest.approx(expected_column(depth=40e-3)[2:70], abs=2)


def test_speed_and_rate_scale_the_depth():
    _, iq, _ = burst(depth=40e-3)
    expected = expected_column(depth=60e-3, extent=30e-3)[5:70]
    faster = bmode(iq, FS, LINES, speed_of_sound=1.5 * C, imaging=PLAIN)
    assert faster[5:70, 0].astype(float) == pytest.approx(expected, abs=2)
    assert np.array_equal(faster, bmode(iq, FS / 1.5, LINES, imaging=PLAIN))


@pytest.mark.parametrize("dynamic_range, expected", [(60.0, 127.5), (40.0, 63.75), (30.0, 0.0), (20.0, 0.0)])
def test_dynamic_range(dynamic_range, expected):
    signals = np.ones((3200, 64), complex)
    signals[1600:] = 10 ** (-30 / 20)
    image = bmode(signals, FS, LINES, imaging=Imaging(dynamic_range_db=dynamic_range))
    assert image[20, 20] == 255
    assert float(image[80, 20]) == pytest.approx(expected, abs=1)


def test_log_compress_by_hand():
    values = np.array([[1.0, 0.1], [0.001, 1e-9]], np.float32)
    assert log_compress(values, 60.0) == pytest.approx(np.array([[60, 40], [0, 0]]), abs=1e-4)


def test_a_line_shows_in_its_column_and_a_sample_in_its_row():
    signals = np.full((3200, 64), 1e-9, complex)
    signals[:, 40] = 1  # at 5.3125 mm: pixel 25 covers 5 to 6 mm
    image = bmode(signals, FS, LINES, imaging=PLAIN)
    assert image[45].argmax() == 25 and not image[45, :24].any() and not image[45, 28:].any()
    signals = np.full((3200, 64), 1e-9, complex)
    signals[round(2 * 30.5e-3 / C * FS)] = 1
    image = bmode(signals, FS, LINES, imaging=PLAIN)
    assert image[:, 20].argmax() == 30 and not image[:29].any() and not image[32:].any()


def test_stripes_finer_than_pixels_become_their_mean():
    signals = np.full((3200, 64), 1e-3, complex)  # -60 dB
    signals[np.arange(3200) // 3 % 2 == 0] = 1  # stripes of 0.09 mm
    image = bmode(signals, FS, LINES, imaging=PLAIN)[1:-1]
    assert np.abs(image - 127.5).max() <= 4
    signals = np.full((3200, 128), 1e-3, complex)
    signals[:, ::2] = 1
    image = bmode(signals, FS, (np.arange(128) - 63.5) * 0.3125e-3, imaging=PLAIN)
    assert np.abs(image[:, 1:-1] - 127.5).max() <= 12


@pytest.mark.parametrize("median_size", [1, 5, 7])
def test_a_constant_stays_constant_to_the_last_corner(median_size):
    for signals in (np.full((3200, 64), 2.5 + 1j), np.full((3200, 1), 3j)):
        lines = LINES if signals.shape[1] == 64 else [0.0]
        assert (bmode(signals, FS, lines, imaging=Imaging(median_size=median_size)) == 255).all()


def test_median_removes_specks_and_repeats_the_border():
    signals = np.full((900, 40), 1e-3, complex)
    rate, lines = C / 2 / 0.1e-3, (np.arange(40) - 19.5) * 1e-3
    signals[300:310, 20] = 1  # one pixel
    signals[600:, 30:] = 1  # a block in the corner
    image = bmode(signals, rate, lines, time_zero=2 * 0.05e-3 / C)
    assert not image[:58].any()
    assert (image[63:, 33:] == 255).all()


@pytest.mark.parametrize("median_size", [1, 5])
def test_an_image_deeper_than_the_samples_is_black_beyond_them(median_size):
    signals, rate = np.full((300, 64), 2.5 + 1j), C / 2 / 0.1e-3  # 300 samples of 0.1 mm
    image = bmode(
        signals,
        rate,
        LINES,
        time_zero=2 * 20.05e-3 / C,
        imaging=Imaging(width_px=10, median_size=median_size),
    )
    assert (image[20:50] == 255).all() and not image[:20].any() and not image[50:].any()


@pytest.mark.parametrize("median_size", [1, 5])
def test_an_image_wider_than_the_lines_is_black_beyond_them(median_size):
    signals = np.full((3200, 64), 2.5 + 1j)
    for pixel in (1e-3, 0.25e-3):
        imaging = Imaging(width_px=round(60e-3 / pixel), pixel_size=pixel, median_size=median_size)
        image = bmode(signals, FS, LINES, imaging=imaging)
        beyond = round(10e-3 / pixel)  # the lines cover 40 mm
        assert not image[:, :beyond].any() and not image[:, -beyond:].any()
        assert (image[:, beyond:-beyond] == 255).all()
        moved = bmode(signals, FS, LINES + 5e-3, imaging=imaging)
        assert np.array_equal(moved[0], np.roll(image[0], round(5e-3 / pixel)))


def test_silence_is_black_without_a_warning():
    # Warnings are errors in these tests.
    for signals in (np.zeros((3200, 64)), np.zeros((3200, 64), np.complex64)):
        image = bmode(signals, FS, LINES)
        assert image.dtype == np.uint8 and not image.any()


def test_the_widest_dynamic_range_shows_what_is_as_weak():
    widest = Imaging(dynamic_range_db=200).dynamic_range_db
    decibels = log_compress(np.array([[1.0], [1e-5], [1e-10]], np.float32), widest)
    assert decibels.ravel() == pytest.approx([200, 100, 0], abs=1e-3)


@pytest.mark.parametrize("factor", [1e-30, 1e12])
def test_units_of_the_signal_do_not_matter(factor):
    rf, _, _ = burst()
    difference = bmode(rf * factor, FS, LINES).astype(int) - bmode(rf, FS, LINES)
    assert np.abs(difference).max() <= 1


@pytest.mark.parametrize("k, focal_depth", [(0, 50e-3), (1, 20e-3)])
def test_image_against_that_of_field_ii(reference_lines, k, focal_depth):
    array, expected = LinearArray(), reference_lines["rf_fst"][k].T.astype(float)
    scene = reference_lines["points"], reference_lines["amplitudes"]
    rf, _ = simulate_rf(*scene, array, focal_depth, reference_lines["x_lines"])
    lines = reference_lines["x_lines"] + 0.3125e-3
    ours, theirs = (
        bmode(signals, FS, lines, time_zero=-array.pulse_delay, imaging=PLAIN) for signals in (rf, expected)
    )
    heard = theirs > 255 / 3  # above -40 dB
    error = (ours.astype(float) - theirs)[heard] * 60 / 255
    assert math.sqrt(np.mean(error**2)) <= 1.0


def test_real_data_against_the_image_of_plus():
    # 16 of 128 lines over 38 mm, 2080 samples over 55 mm, deepest first. PLUS takes the fourth root of the
    # envelope of the nearest sample and leaves the ends of a line black, where its Hilbert filter would not
    # reach.
    with np.load(REFERENCE / "plus_frame.npz") as file:
        rows, theirs = file["iq_rows"].astype(float), file["image"]
    iq = (rows[0::2] + 1j * rows[1::2]).T[::-1].copy()
    iq[:17], iq[-17:] = 0, 0
    middle = (72 + 95) / 2 * 0.2e-3  # of the columns 72 to 94 of the whole image
    ours = bmode(
        iq,
        sampling_frequency=2080 * C / (2 * 55e-3),
        line_positions=(np.arange(48, 64) + 0.5) * 38e-3 / 128 - middle,
        time_zero=0.2e-3 / C,  # a pixel of PLUS begins where ours has its centre
        imaging=Imaging(60.0, *theirs.shape, 0.2e-3, median_size=1),
    )
    assert np.corrcoef(ours.ravel(), theirs.ravel())[0, 1] >= 0.95  # mirrored lines have 0.94


# Bad input


@pytest.mark.parametrize("signals", [np.zeros(10), np.zeros((0, 4)), np.zeros((3, 0)), np.zeros((2, 2, 2))])
def test_refuses_shapes(signals):
    with pytest.raises(ValueError, match=r"signals must have shape \(n_samples, n_lines\)"):
        bmode(signals, FS, LINES)


@pytest.mark.parametrize("value", [math.nan, math.inf, complex(0, math.nan)])
def test_refuses_signals_that_are_not_finite(value):
    signals = np.ones((100, 64), complex if isinstance(value, complex) else float)
    signals[3, 3] = value
    with pytest.raises(ValueError, match="signals must be finite"):
        bmode(signals, FS, LINES)


@pytest.mark.parametrize(
    "lines",
    [LINES[:-1], LINES[::-1], np.zeros(64), np.full(64, math.nan), 0.0, LINES**3],
    ids=["too few", "falling", "equal", "nan", "no array", "unequal steps"],
)
def test_refuses_lines(lines):
    with pytest.raises(ValueError, match="line_positions must be 64 increasing, equally spaced positions"):
        bmode(np.ones((100, 64)), FS, lines)


def test_refuses_another_number_of_lines_than_the_arrays():
    said = r"signals must be \(n_samples, 64\), a column for each line of the array, not \(100, 5\)"
    with pytest.raises(ValueError, match=said):
        simulated_bmode(np.ones((100, 5)), LinearArray())


def test_refuses_a_single_line_at_nan():
    with pytest.raises(ValueError, match="line_positions must be 1 increasing"):
        bmode(np.ones((100, 1)), FS, [math.nan])


@pytest.mark.parametrize("lines", [LINES + 1j, [str(line) for line in LINES]], ids=["complex", "texts"])
def test_refuses_lines_that_are_no_real_numbers(lines):
    with pytest.raises(ValueError, match="line_positions must be real numbers"):
        bmode(np.ones((100, 64)), FS, lines)


def test_the_slowest_array_that_there_may_be_makes_a_frame():
    slow = LinearArray(center_frequency=1e5)
    assert slow.iq_sampling_frequency < 1e6
    pixels = simulated_bmode(np.ones((40, slow.n_lines), np.complex64), slow)
    assert pixels.shape == (90, 40) and pixels.max() == 255
    with pytest.raises(ValueError, match=r"sampling_frequency .* not 40: did you mean 4e7 \(40 MHz\)\?"):
        bmode(np.ones((100, 64)), 40, LINES)


@pytest.mark.parametrize("value", [0, -1.0, math.nan, math.inf])
@pytest.mark.parametrize("name", ["sampling_frequency", "speed_of_sound"])
def test_refuses_rates_and_speeds(name, value):
    arguments = {"sampling_frequency": FS, "speed_of_sound": C} | {name: value}
    with pytest.raises(ValueError, match=f"^{name} must be a positive number, not {value}"):
        bmode(np.ones((100, 64)), line_positions=LINES, **arguments)


@pytest.mark.parametrize("value", [math.nan, -math.inf])
def test_refuses_a_time_zero(value):
    with pytest.raises(ValueError, match=f"^time_zero must be a finite number, not {value}"):
        bmode(np.ones((100, 64)), FS, LINES, time_zero=value)


@pytest.mark.parametrize("value", [2.5, 0.0007, -0.0011])
def test_refuses_samples_from_no_depth_of_an_image(value):
    with pytest.raises(ValueError, match=rf"^time_zero must put samples into .* 0.5 m, not {value} s: they"):
        bmode(np.ones((100, 64)), FS, LINES, time_zero=value)


def test_a_long_pulse_of_a_low_frequency_makes_a_frame():
    low = {"center_frequency": 1e5, "sampling_frequency": 1e6, "n_lines": 4, "n_elements": 16, "n_active": 8}
    array = LinearArray(**low, excitation_cycles=100, impulse_response_cycles=100)
    rf, _ = simulate_rf([(0, 0, 0.05)], [1.0], array, 0.05)
    assert simulated_bmode(rf, array).max() == 255


def test_samples_at_the_edge_of_a_pixel_are_seen():
    signals, step = np.zeros((8945, 64)), 1e-5  # m; to 89.44 mm
    signals[8900:8941] = 1
    image = bmode(signals + 0j, C / 2 / step, LINES, imaging=Imaging(width_px=10, median_size=1))
    assert image.argmax(axis=0).tolist() == [89] * 10 and not image[:88].any()


@pytest.mark.parametrize("name", ["dynamic_range_db", "pixel_size", "height_px", "width_px", "median_size"])
@pytest.mark.parametrize("value", [0, -5, "3", None, True, math.nan])
def test_refuses_imaging(name, value):
    with pytest.raises((TypeError, ValueError), match=rf"^{name} must be .*, not {value!r}\.$"):
        Imaging(**{name: value})


@pytest.mark.parametrize("value", [200.5, 900, 1000])
def test_refuses_a_dynamic_range_of_which_there_are_no_numbers(value):
    said = f"dynamic_range_db must be a number in (0, 200], not {value}."
    with pytest.raises(ValueError, match=f"^{re.escape(said)}$"):
        Imaging(dynamic_range_db=value)


@pytest.mark.parametrize(("name", "most"), [("height_px", 500), ("width_px", 500), ("median_size", 255)])
def test_refuses_images_that_are_too_large(name, most):
    assert getattr(Imaging(**{name: most - 1 + most % 2}), name)
    with pytest.raises(ValueError, match=rf"{name} must be a whole number in \[1, {most}\]"):
        Imaging(**{name: most + 2})


def test_refuses_images_of_too_many_pixels():
    assert Imaging(height_px=10_000, width_px=10_000, pixel_size=2e-6)
    with pytest.raises(ValueError, match="an image must have at most 100000000 pixels, not 10001 x 10000"):
        Imaging(height_px=10_001, width_px=10_000, pixel_size=2e-6)


def test_median_of_the_largest_size_is_that_of_numpy():
    image = np.random.default_rng(0).integers(0, 256, (90, 40), dtype=np.uint8)
    edge = MOST_MEDIAN // 2
    padded = np.pad(image, edge, mode="edge")
    seen = cv2.medianBlur(image, MOST_MEDIAN)
    for row, column in ((0, 0), (45, 20), (89, 39)):
        assert seen[row, column] == np.median(padded[row : row + MOST_MEDIAN, column : column + MOST_MEDIAN])


@pytest.mark.parametrize(
    ("sampling_frequency", "lines_m", "said"),
    [
        (40, np.linspace(-0.02, 0.02, 8), "did you mean 4e7 "),
        (40e6, np.linspace(-20, 20, 8), "did you mean 0.02 "),
    ],
)
def test_measured_data_in_other_units_are_asked_about(sampling_frequency, lines_m, said):
    with pytest.raises(ValueError, match=said):
        bmode(np.ones((100, 8)), sampling_frequency, lines_m)


@pytest.mark.parametrize("name", ["height_px", "width_px", "median_size"])
def test_refuses_broken_pixels(name):
    with pytest.raises(ValueError, match=rf"{name} must be a whole number in \[1, \d+\], not 3.5"):
        Imaging(**{name: 3.5})


def test_refuses_an_even_median():
    with pytest.raises(ValueError, match="median_size must be odd, not 4"):
        Imaging(median_size=4)


def test_refuses_a_pixel_size_in_mm():
    with pytest.raises(ValueError, match=r"m, not 0.2: did you mean 0.0002 \(0.2 mm\)\?$"):
        Imaging(pixel_size=0.2)


@pytest.mark.parametrize("value", [-60, math.nan, math.inf, "60", True, [60]])
def test_refuses_noise(value):
    said = re.escape(f"noise_db must be a non-negative number, not {value!r}.")
    with pytest.raises((TypeError, ValueError), match=f"^{said}$"):
        Imaging(noise_db=value)


@pytest.mark.parametrize("value", [-1, 101, math.nan, "3", None, True, {0.0: 1.0}])
def test_refuses_a_gain(value):
    said = "tgc_db_per_cm must be a number in [0, 100] dB/cm or pairs of depth (m) and gain (dB), not "
    with pytest.raises((TypeError, ValueError), match=f"^{re.escape(f'{said}{value!r}.')}$"):
        Imaging(tgc_db_per_cm=value)


@pytest.mark.parametrize(
    ("curve", "said"),
    [
        ([], "must be a number or pairs of depth (m) and gain (dB), not []."),
        ([0.01, 0.02], "must be a number or pairs of depth (m) and gain (dB), not [0.01, 0.02]."),
        ([(0.01, 1, 2)], "must be a number or pairs of depth (m) and gain (dB), not [(0.01, 1, 2)]."),
        (["ab"], "must be a number or pairs of depth (m) and gain (dB), not ['ab']."),
        ([(0.02, 1), (0.01, 2)], "must increase, not go from 0.02 to 0.01 m."),
        ([(0.02, 1), (0.02, 2)], "must increase, not go from 0.02 to 0.02 m."),
        ([(20, 1)], "must be a number in [0, 0.5] m, not 20: did you mean 0.02 (20 mm)?"),
        ([(math.nan, 1)], "the depth of a pair of tgc_db_per_cm must be a non-negative number, not nan."),
        ([(0.02, math.inf)], "the gain of a pair of tgc_db_per_cm must be a number in [-200, 200], not inf."),
        ([(0.02, "1")], "the gain of a pair of tgc_db_per_cm must be a number in [-200, 200], not '1'."),
    ],
)
def test_refuses_a_curve_of_gain(curve, said):
    with pytest.raises((TypeError, ValueError), match=f"{re.escape(said)}$"):
        Imaging(tgc_db_per_cm=curve)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("factor", [1e39, 1e300])
@pytest.mark.parametrize("which", [0, 1])
def test_refuses_signals_beyond_the_numbers_of_an_envelope(factor, which):
    with pytest.raises(ValueError, match=r"signals must be so weak that the envelope is below 3\.4e38"):
        bmode(burst()[which] * factor, FS, LINES)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("factor", [1e-44, 1e-50, 1e-300])
def test_signals_too_weak_for_a_dynamic_range_are_silence(factor):
    assert not bmode(burst()[1] * factor, FS, LINES).any()


def test_signals_that_are_no_numbers_are_refused():
    with pytest.raises(ValueError, match="signals must be real or complex numbers, not object"):
        envelope(np.array([[1, None], [2, 3]]))


@pytest.mark.parametrize("imaging", [None, {"height_px": 3}])
def test_what_is_no_imaging_is_refused(imaging):
    rf, _, _ = burst()
    with pytest.raises(TypeError, match="imaging must be of type Imaging, not"):
        bmode(rf, FS, LINES, imaging=imaging)
