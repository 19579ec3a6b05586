"""The specification's model of the RF, summed slowly over elements and their rectangles in float64.

Independent of the simulator: nothing but the configuration of `LinearArray` is taken from the package.
"""

import numpy as np


def excited_pulse(array):
    """Excitation convolved with both impulse responses at `array.sampling_frequency`, (n_samples,)."""
    f0, fs = array.center_frequency, array.sampling_frequency
    t, t_response = (
        np.arange(int(cycles / f0 * fs + 1e-9) + 1) / fs
        for cycles in (array.excitation_cycles, array.impulse_response_cycles)
    )
    response = np.sin(2 * np.pi * f0 * t_response) * np.hanning(len(t_response) + 2)[1:-1]
    return np.convolve(np.convolve(np.sin(2 * np.pi * f0 * t), response), response) / fs**2


def active_elements(array, line):
    """Lateral positions of the elements of the line at `line`, (n_active,) m."""
    pitch = array.element_width + array.kerf
    first = np.floor(line / pitch + array.n_elements / 2 - array.n_active / 2 + 0.5)
    first = min(max(first, 0), array.n_elements - array.n_active)
    return (first + np.arange(array.n_active) - (array.n_elements - 1) / 2) * pitch


def paths(point, array, focal_depth, line):
    """Distance (n_active, n_elevation) of `point` from every rectangle, its offsets, and r + F - hypot(x, F).

    An element at x fires F - hypot(x - line, F) over c after the line's reference point.
    """
    x = active_elements(array, line)[:, np.newaxis]
    height = array.element_height / array.n_elevation
    y = (np.arange(array.n_elevation) - (array.n_elevation - 1) / 2) * height
    dx, dy = point[0] - x, point[1] - y
    r = np.sqrt(dx**2 + dy**2 + point[2] ** 2)
    return r, dx, dy, r + focal_depth - np.hypot(x - line, focal_depth)


def one_way(point, array, focal_depth, line, frequencies, start=0.0, attenuation=0.0):
    """Spectrum of the aperture's spatial impulse response after `start` s, (n_frequencies,).

    Far field of rectangles (Jensen and Svendsen 1992), each attenuated (dB / cm / MHz) on its own way.
    """
    c, height = array.speed_of_sound, array.element_height / array.n_elevation
    r, dx, dy, path = paths(point, array, focal_depth, line)
    gain = np.hanning(array.n_active + 2)[1:-1, np.newaxis] * array.element_width * height / (2 * np.pi * r)
    across, along, turns = array.element_width * dx / (r * c), height * dy / (r * c), path / c - start
    decibels = attenuation * r * 1e2 / 1e6
    return np.array(
        [
            np.sum(
                gain
                * np.sinc(f * across)
                * np.sinc(f * along)
                * 10 ** (-decibels * f / 20)
                * np.exp(-2j * np.pi * f * turns)
            )
            for f in frequencies
        ]
    )


def rf(positions, amplitudes, array, focal_depth, lines, time, attenuation=0.0):
    """RF at `time` (n_samples,) s, equally spaced, (n_samples, n_lines)."""
    step, pulse = time[1] - time[0], excited_pulse(array)
    at = np.arange(len(pulse)) / array.sampling_frequency
    result = np.zeros((len(time), len(lines)))
    for i, line in enumerate(lines):
        for point, amplitude in zip(np.asarray(positions, float), amplitudes, strict=True):
            # Only the time in which this point's echo arrives.
            path = paths(point, array, focal_depth, line)[-1]
            first = int((2 * path.min() / array.speed_of_sound - time[0]) / step) - 8
            n = 2 * int((np.ptp(path) / array.speed_of_sound + at[-1] / 2) / step) + 24
            f = np.fft.rfftfreq(n, step)
            spectrum = np.exp(-2j * np.pi * np.outer(f, at)) @ pulse
            heard = np.abs(spectrum) > 1e-4 * np.abs(spectrum).max()
            start = (time[0] + first * step) / 2
            spectrum *= amplitude * heard
            spectrum[heard] *= one_way(point, array, focal_depth, line, f[heard], start, attenuation) ** 2
            begin, end = max(first, 0), min(first + n, len(time))
            if begin < end:
                result[begin:end, i] += np.fft.irfft(spectrum, n)[begin - first : end - first] / step
    return result
