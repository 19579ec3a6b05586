"""The model of the simulator as it is written: a sum over scatterers, elements and their rectangles.

    rf_l(t) = pulse(t) * sum_s a_s [h_l(r_s, t) * h_l(r_s, t)]        (* is convolution in time)

Jensen (1991): the echo of a point scatterer is the pulse, convolved with the spatial impulse responses of the
transmitting and of the receiving aperture, which are one aperture here unless `LinearArray.receive_focus` or
`receive_f_number` set them apart. Convolutions are computed as products
of spectra, in float64. This file is made to be read, and docs/physics.md walks through it. A frame takes
most of an hour; `usbench.envs.rf.simulate_rf` computes the same in milliseconds, and the tests compare both.
Only the configuration of `LinearArray` is taken from elsewhere.

Sources, in full in docs/physics.md: Jensen (1991), the sum over scatterers; Tupholme (1969) and Stepanishen
(1971), spatial impulse responses; Jensen and Svendsen (1992), rectangles in their far field; Szabo (2004),
attenuation.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from usbench.envs.probe import LinearArray

Floats = npt.NDArray[np.float64]
Spectrum = npt.NDArray[np.complex128]

_HEARD = 1e-4  # of the pulse's largest magnitude: weaker frequencies are left out


def slow_rf(
    positions: npt.ArrayLike,
    amplitudes: npt.ArrayLike,
    array: LinearArray,
    focal_depth: float,
    line_positions: npt.ArrayLike | None = None,
    attenuation_db_per_cm_mhz: float = 0.0,
    time: Floats | None = None,
) -> tuple[Floats, Floats]:
    """Simulate the RF of all lines; the arguments are those of `simulate_rf`, and are not checked.

    Args:
        positions: Scatterers in the probe's coordinate system (lateral, elevation, depth), (n, 3) m.
        amplitudes: Their scattering amplitudes, (n,).
        array: The transducer.
        focal_depth: Of transmit and, without a `receive_focus`, of receive, m.
        line_positions: Lateral positions of the lines, (n_lines,) m; default `array.line_positions`.
        attenuation_db_per_cm_mhz: Of the tissue, 0 for none.
        time: Equally spaced sampling times, (n_samples,) s; default from 0 to the end of the last echo, at
            `array.rf_sampling_frequency`.

    Returns:
        rf (n_samples, n_lines) and time (n_samples,) in s.
    """
    points = np.asarray(positions, dtype=np.float64).reshape(-1, 3)
    weights = np.asarray(amplitudes, dtype=np.float64)
    lines = np.asarray(array.line_positions if line_positions is None else line_positions, dtype=np.float64)
    if time is None:
        time = _until_the_last_echo(points, array, focal_depth, lines)
    rf = np.zeros((len(time), len(lines)))
    for i, line in enumerate(lines):
        for point, amplitude in zip(points, weights, strict=True):
            first, samples = _echo(point, array, focal_depth, line, attenuation_db_per_cm_mhz, time)
            begin, end = max(first, 0), min(first + len(samples), len(time))
            if begin < end:
                rf[begin:end, i] += amplitude * samples[begin - first : end - first]
    return rf, time


def excited_pulse(array: LinearArray) -> Floats:
    """Return excitation * impulse response * impulse response at `array.sampling_frequency`, (n_samples,)."""
    f0, fs = array.center_frequency, array.sampling_frequency
    t = np.arange(int(array.excitation_cycles / f0 * fs + 1e-9) + 1) / fs
    excitation = np.sin(2 * np.pi * f0 * t)
    t = np.arange(int(array.impulse_response_cycles / f0 * fs + 1e-9) + 1) / fs
    impulse_response = np.sin(2 * np.pi * f0 * t) * _hann(len(t))
    return np.convolve(np.convolve(excitation, impulse_response), impulse_response) / fs**2


def active_elements(array: LinearArray, line: float) -> Floats:
    """Return the lateral positions of the elements nearest to the line at `line`, (n_active,) m."""
    pitch = array.element_width + array.kerf
    first = np.floor(line / pitch + array.n_elements / 2 - array.n_active / 2 + 0.5)
    first = min(max(first, 0), array.n_elements - array.n_active)
    return np.asarray((first + np.arange(array.n_active) - (array.n_elements - 1) / 2) * pitch)


def delays(elements: Floats, focal_depth: float, line: float) -> Floats:
    """Return by how much the elements at (n_active,) m fire before the line's reference point, (n_active,) m.

    As a distance: their waves and that of the point (line, 0, 0) meet in the focus (line, 0, focal_depth).
    """
    return np.hypot(elements - line, focal_depth) - focal_depth


def receive_depth(array: LinearArray, focal_depth: float, line: float, point: Floats) -> float:
    """Return the depth of the receive focus when the echo of `point` (3,) m arrives, m.

    Dynamic focusing is at c t / 2: the echo's is the point's distance from the line's reference point.
    """
    if array.receive_focus is None:
        return focal_depth
    if array.receive_focus == "dynamic":
        return float(np.linalg.norm(point - [line, 0.0, 0.0]))
    return float(array.receive_focus)


def receive_weights(array: LinearArray, elements: Floats, line: float, depth: float) -> Floats:
    """Return the weights in receive with the focus at `depth` (m) of elements at (n_active,) m, as many."""
    if array.receive_f_number is None:
        return _hann(array.n_active)
    pitch = array.element_width + array.kerf
    width = min(max(depth / array.receive_f_number, pitch), array.n_active * pitch) + pitch
    return np.where(np.abs(elements - line) < width / 2, np.cos(np.pi * (elements - line) / width) ** 2, 0.0)


def one_way(
    point: npt.ArrayLike,
    array: LinearArray,
    focal_depth: float,
    line: float,
    frequencies: Floats,
    attenuation_db_per_cm_mhz: float = 0.0,
    start: float = 0.0,
    receive: bool = False,
) -> Spectrum:
    """Return H_l(f), the spectrum of the spatial impulse response h_l(t) after `start` s, (n_frequencies,).

    That of the transmitting aperture, or of the receiving one.

    Each element is divided into `array.n_elevation` rectangles, and `point` lies in the far field of each
    (Jensen and Svendsen 1992):

        H_l(f) = sum over rectangles of w A / (2 pi r) sinc(f width dx / (r c)) sinc(f height dy / (r c))
                 10^(-attenuation r f / 20) exp(-2 pi j f (r - delay) / c)
    """
    x, y, z = np.asarray(point, dtype=np.float64)
    c, width, height = array.speed_of_sound, array.element_width, array.element_height / array.n_elevation
    elements, weights, depth = active_elements(array, line), _hann(array.n_active), focal_depth
    if receive:
        depth = receive_depth(array, focal_depth, line, np.asarray(point))
        weights = receive_weights(array, elements, line, depth)
    elements = elements[:, np.newaxis]
    rows = (np.arange(array.n_elevation) - (array.n_elevation - 1) / 2) * height
    dx, dy = x - elements, y - rows
    r = np.sqrt(dx**2 + dy**2 + z**2)  # (n_active, n_elevation)
    gain = weights[:, np.newaxis] * width * height / (2 * np.pi * r)
    arrival = (r - delays(elements, depth, line)) / c - start
    decibels_per_hz = attenuation_db_per_cm_mhz * (r / 1e-2) / 1e6

    spectrum = np.empty(len(frequencies), dtype=np.complex128)
    for i, f in enumerate(frequencies):
        directivity = np.sinc(f * width * dx / (r * c)) * np.sinc(f * height * dy / (r * c))
        attenuation = 10 ** (-decibels_per_hz * f / 20)
        spectrum[i] = np.sum(gain * directivity * attenuation * np.exp(-2j * np.pi * f * arrival))
    return spectrum


def _echo(
    point: Floats, array: LinearArray, focal_depth: float, line: float, attenuation: float, time: Floats
) -> tuple[int, Floats]:
    """Return pulse * h_l * h_l of one point, only while it lasts, and the index of its first sample."""
    pulse, step = excited_pulse(array), time[1] - time[0]
    pulse_time = np.arange(len(pulse)) / array.sampling_frequency
    earliest, latest = _arrivals(point, array, focal_depth, line)
    first = int((earliest - time[0]) / step) - 8
    n = 2 * int((latest - earliest + pulse_time[-1]) / 2 / step) + 24

    f = np.fft.rfftfreq(n, step)
    spectrum = np.exp(-2j * np.pi * np.outer(f, pulse_time)) @ pulse
    heard = np.abs(spectrum) > _HEARD * np.abs(spectrum).max()
    start = (time[0] + first * step) / 2  # one way: half of it
    ways = point, array, focal_depth, line, f[heard], attenuation, start
    there = one_way(*ways)
    spectrum[heard] *= there * (one_way(*ways, receive=True) if array.receives_apart else there)
    spectrum[~heard] = 0.0
    return first, np.fft.irfft(spectrum, n) / step


def _arrivals(point: Floats, array: LinearArray, focal_depth: float, line: float) -> tuple[float, float]:
    """Return the first and the last time that the way over `point` to and from the aperture takes, s."""
    elements = active_elements(array, line)[:, np.newaxis]
    half_height = array.element_height / 2
    nearest = max(abs(point[1]) - half_height, 0.0)
    distances = np.hypot(point[0] - elements, np.hypot(point[2], [nearest, abs(point[1]) + half_height]))
    depths = focal_depth, receive_depth(array, focal_depth, line, point)
    there, back = (distances - delays(elements, depth, line) for depth in depths)
    c = array.speed_of_sound
    return float(there.min() + back.min()) / c, float(there.max() + back.max()) / c


def _until_the_last_echo(points: Floats, array: LinearArray, focal_depth: float, lines: Floats) -> Floats:
    """Return the sampling times from 0 to the end of the last echo, (n_samples,) s."""
    arrivals = [_arrivals(point, array, focal_depth, line)[1] for line in lines for point in points]
    latest = max(arrivals, default=0.0)
    duration = latest + len(excited_pulse(array)) / array.sampling_frequency
    return np.arange(int(np.ceil(duration * array.rf_sampling_frequency)) + 1) / array.rf_sampling_frequency


def _hann(n: int) -> Floats:
    """Return the Hann window of `n` samples without the zeros at its ends, (n,)."""
    return np.asarray(np.hanning(n + 2)[1:-1])
