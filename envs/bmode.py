"""From RF or I/Q to a B-mode image: envelope, decibels, resampling with anti-aliasing, median."""

from __future__ import annotations

import math
import reprlib
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt
from scipy import sparse

from usbench.checks import (
    HERTZ,
    METRES,
    check_type,
    meant,
    non_negative,
    number,
    positive,
    quantity,
    whole_number,
)
from usbench.envs.arrays import real
from usbench.envs.probe import LinearArray, bounded, check_array
from usbench.envs.receiver import gain

# The widest dynamic range, more than any receiver has: far beyond it, envelopes have no such numbers.
MOST_DB = 200
# Of an image, m: no echo is simulated from farther away.
MOST_SIZE = 0.5
MOST_PIXELS = 100_000_000
# Edge of the median filter: beyond it OpenCV's medians of bytes are wrong, without a word.
MOST_MEDIAN = 255


@dataclass(frozen=True)
class Imaging:
    """How echoes are received and become an image.

    Attributes:
        dynamic_range_db: Shown below the frame's maximum, at most 200; everything weaker is black.
        height_px: Rows; the first begins at depth 0. The image is at most 0.5 m deep and wide, with at most
            100 million pixels.
        width_px: Columns, centred on the probe.
        pixel_size: Edge of a pixel, m.
        median_size: Edge of the median filter, an odd number of pixels up to 255; 1 for none.
        noise_db: Root mean square of the noise of the receiver's electronics, dB below the echo of a unit
            point 50 mm deep, see `receiver/noise.py`; without a value there is no noise.
        tgc_db_per_cm: Time gain compensation, dB per cm of depth, or a curve: pairs of depth (m) and gain
            (dB) with depths that increase, linear between them.

    Raises:
        TypeError: If an attribute has a wrong type.
        ValueError: If a value is not allowed; the message says what is.
    """

    dynamic_range_db: float = 60.0
    height_px: int = 90
    width_px: int = 40
    pixel_size: float = 1e-3
    median_size: int = 5
    noise_db: float | None = None
    tgc_db_per_cm: float | gain.Curve = 0.0

    def __post_init__(self) -> None:
        """Refuse values that make no image."""
        range_db = number("dynamic_range_db", self.dynamic_range_db, low=0, high=MOST_DB, above=True)
        object.__setattr__(self, "dynamic_range_db", range_db)
        positive("pixel_size", self.pixel_size)
        object.__setattr__(self, "pixel_size", quantity("pixel_size", self.pixel_size, 1e-6, 20e-3, METRES))
        most = math.floor(MOST_SIZE / self.pixel_size * (1 + 1e-9))
        for name, high in (("height_px", most), ("width_px", most), ("median_size", MOST_MEDIAN)):
            object.__setattr__(self, name, whole_number(name, getattr(self, name), 1, high))
        if self.height_px * self.width_px > MOST_PIXELS:
            raise ValueError(
                f"an image must have at most {MOST_PIXELS} pixels, not {self.height_px} x {self.width_px}."
            )
        if self.median_size % 2 == 0:
            raise ValueError(f"median_size must be odd, not {self.median_size}.")
        if self.noise_db is not None:
            object.__setattr__(self, "noise_db", non_negative("noise_db", self.noise_db))
        object.__setattr__(self, "tgc_db_per_cm", gain.checked("tgc_db_per_cm", self.tgc_db_per_cm))

    @property
    def width(self) -> float:
        """Width of the image, m."""
        return self.width_px * self.pixel_size

    @property
    def depth(self) -> float:
        """Depth of the image's lower edge, m."""
        return self.height_px * self.pixel_size


DEFAULT_IMAGING = Imaging()


def envelope(signals: npt.ArrayLike) -> npt.NDArray[np.float32]:
    """Return the envelope (n_samples, n_lines) of I/Q or RF, (n_samples, n_lines).

    It is the magnitude of complex I/Q, and that of the analytic signal of real RF.

    Raises:
        ValueError: If they are no numbers, the shape is another, a value is not finite, or the envelope is
            beyond 3.4e38.
    """
    array = np.asarray(signals)
    if array.dtype.kind not in "biufc":
        raise ValueError(f"signals must be real or complex numbers, not {array.dtype}.")
    if array.ndim != 2 or array.size == 0:
        raise ValueError(f"signals must have shape (n_samples, n_lines), not {array.shape}.")
    if not np.isfinite(array).all():
        raise ValueError("signals must be finite, without NaN.")
    if not np.iscomplexobj(array):
        from scipy import signal  # takes a second, and frames of the simulator need it not

        padded = 2 ** math.ceil(math.log2(2 * len(array)))  # as the transform is periodic
        array = signal.hilbert(array, N=padded, axis=0)[: len(array)]
    with np.errstate(over="ignore"):
        found = np.asarray(np.abs(array), dtype=np.float32)
    if not np.isfinite(found).all():
        raise ValueError(
            "signals must be so weak that the envelope is below 3.4e38, the largest 32-bit number."
        )
    return found


def bmode(
    signals: npt.ArrayLike,
    sampling_frequency: float,
    line_positions: npt.ArrayLike,
    time_zero: float = 0.0,
    speed_of_sound: float = 1540.0,
    imaging: Imaging = DEFAULT_IMAGING,
) -> npt.NDArray[np.uint8]:
    """Make an image of RF or I/Q, also of measured data.

    Args:
        signals: RF (real) or I/Q (complex), (n_samples, n_lines).
        sampling_frequency: Of `signals`, Hz.
        line_positions: Lateral positions of the lines, increasing in equal steps, (n_lines,) m.
        time_zero: Time of the first sample after the arrival of an echo from depth 0, s; the middle of the
            pulse counts.
        speed_of_sound: m/s.
        imaging: Size, dynamic range and time gain compensation of the image; no noise is added here.

    Returns:
        (height_px, width_px) uint8; 255 is the maximum, 0 is `dynamic_range_db` below it or weaker. Black too
        is what lies more than half a step beyond the outermost lines, and rows that no sample reaches. A line
        alone fills the image's width.

    Raises:
        TypeError: If a value is no number, or `imaging` no `Imaging`.
        ValueError: If shapes do not fit, a value is not allowed, or no sample comes from 0 to 0.5 m of depth.
    """
    check_type("imaging", imaging, Imaging)
    envelopes = envelope(signals)
    lines = real("line_positions", line_positions)
    steps = np.diff(lines, prepend=lines[:1]) if lines.ndim == 1 else lines
    if (
        lines.shape != (envelopes.shape[1],)
        or not np.isfinite(lines).all()
        or not (steps[1:] > 0).all()
        or not np.allclose(steps[1:], steps[1:2], rtol=1e-3, atol=0.0)
    ):
        raise ValueError(
            f"line_positions must be {envelopes.shape[1]} increasing, equally spaced positions, "
            f"not {reprlib.repr(lines.tolist())}."
        )
    if (farthest := float(np.abs(lines).max(initial=0.0))) > MOST_SIZE:
        hint = meant(farthest, 1e-3, MOST_SIZE, METRES)
        raise ValueError(f"line_positions must be within {MOST_SIZE} m, not {farthest:g} m{hint or '.'}")
    # From the I/Q of the lowest centre frequency, whose rate is 1.4 times that.
    positive("sampling_frequency", sampling_frequency)
    sampling_frequency = quantity("sampling_frequency", sampling_frequency, 1e5, 1e10, HERTZ)
    speed_of_sound = bounded("speed_of_sound", speed_of_sound)
    number("time_zero", time_zero)
    first, step = time_zero * speed_of_sound / 2, speed_of_sound / (2 * sampling_frequency)
    last = first + (len(envelopes) - 1) * step
    if first > MOST_SIZE or last < 0:
        raise ValueError(
            f"time_zero must put samples into depths from 0 to {MOST_SIZE} m, not {time_zero!r} s: they "
            f"would come from {first:g} to {last:g} m."
        )
    if imaging.tgc_db_per_cm != 0.0:
        depths = first + np.arange(len(envelopes)) * step
        envelopes = gain.amplified(envelopes, depths, imaging.tgc_db_per_cm)
    decibels = log_compress(envelopes, imaging.dynamic_range_db)
    rows = _resampling(len(decibels), first, step, imaging.height_px, imaging.pixel_size)
    spacing = float(steps[1:].mean()) if len(lines) > 1 else imaging.pixel_size
    left = -imaging.width_px / 2 * imaging.pixel_size
    columns = _resampling(len(lines), float(lines[0]) - left, spacing, imaging.width_px, imaging.pixel_size)
    image: npt.NDArray[np.float32] = columns @ (rows @ decibels).T
    pixels = np.rint(image.T * np.float32(255.0 / imaging.dynamic_range_db)).astype(np.uint8)
    # cv2 repeats the border: zeros there would darken it, and the corners most. So would zeros beyond the
    # lines, which are therefore put there at the end.
    if imaging.median_size > 1:
        pixels = np.asarray(cv2.medianBlur(pixels, imaging.median_size))
    pixel = imaging.pixel_size
    pixels[_beyond(imaging.height_px, pixel, first, last, max(step, pixel) / 2)] = 0
    if len(lines) > 1:
        leftmost, rightmost = (float(line) - left for line in (lines[0], lines[-1]))
        pixels[:, _beyond(imaging.width_px, pixel, leftmost, rightmost, spacing / 2)] = 0
    return np.asarray(pixels)


def simulated_bmode(
    signals: npt.ArrayLike,
    array: LinearArray,
    imaging: Imaging = DEFAULT_IMAGING,
    line_positions: npt.ArrayLike | None = None,
) -> npt.NDArray[np.uint8]:
    """Make an image of what `simulate_rf` or `simulate_iq` returned: a point is shown where it is.

    Simulated time counts from the pulse's start, and the middle of the pulse comes `array.pulse_delay` later.

    Args:
        signals: RF (real) or I/Q (complex), (n_samples, n_lines).
        array: The array with which they were simulated.
        imaging: Size, dynamic range and time gain compensation of the image; no noise is added here.
        line_positions: As they were simulated, (n_lines,) m; default `array.line_positions`.

    Returns:
        (height_px, width_px) uint8, as `bmode`.

    Raises:
        TypeError: If `array` is no `LinearArray`.
        ValueError: If a value is not allowed, or the signals have another number of lines.
    """
    check_array(array)
    n_lines = np.shape(signals)[1] if np.ndim(signals) == 2 else 0
    if line_positions is None and n_lines != array.n_lines:
        raise ValueError(
            f"signals must be (n_samples, {array.n_lines}), a column for each line of the array, not "
            f"{np.shape(signals)}."
        )
    is_iq = np.iscomplexobj(signals)
    return bmode(
        signals,
        array.iq_sampling_frequency if is_iq else array.rf_sampling_frequency,
        array.line_positions if line_positions is None else line_positions,
        time_zero=-array.pulse_delay,
        speed_of_sound=array.speed_of_sound,
        imaging=imaging,
    )


def log_compress(envelopes: npt.NDArray[np.float32], dynamic_range_db: float) -> npt.NDArray[np.float32]:
    """Return decibels above the lower end of the dynamic range, 0 .. dynamic_range_db; silence is 0."""
    largest = float(envelopes.max(initial=0.0))
    floor = np.float32(largest * 10.0 ** (-dynamic_range_db / 20))
    if floor == 0.0:  # also of what is weaker than 32 bits can tell from silence
        return np.zeros_like(envelopes)
    decibels = 20.0 * np.log10(np.maximum(envelopes, floor) / floor)
    return decibels.astype(np.float32, copy=False)


def _beyond(n: int, pixel_size: float, first: float, last: float, margin: float) -> npt.NDArray[np.bool_]:
    """Return which of n pixels from 0 on have a centre more than `margin` before `first` or after `last`."""
    centers, margin = (np.arange(n) + 0.5) * pixel_size, margin * (1 + 1e-9)
    return (centers < first - margin) | (centers > last + margin)


@lru_cache(maxsize=64)
def _resampling(n_in: int, first: float, step: float, n_out: int, pixel_size: float) -> sparse.csr_array:
    """Return the matrix (n_out, n_in) from samples at first, first + step, .. to pixels from 0, in m.

    Linear interpolation with anti-aliasing: a triangle as wide as the coarser of both grids, normalised to 1,
    which also repeats the border. Pixels that no sample reaches take the nearest one.
    """
    centers = (np.arange(n_out) + 0.5) * pixel_size
    samples = first + np.arange(n_in) * step
    weights = np.maximum(0.0, 1.0 - np.abs(centers[:, np.newaxis] - samples) / max(pixel_size, step))
    empty = weights.sum(axis=1) == 0
    weights[empty, np.abs(centers[empty, np.newaxis] - samples).argmin(axis=1)] = 1.0
    return sparse.csr_array((weights / weights.sum(axis=1, keepdims=True)).astype(np.float32))
