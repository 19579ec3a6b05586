"""One-way response of the focused aperture in the plane of the array, the sum over its elements.

Far field of rectangular elements (Jensen and Svendsen 1992), each a sinc across its width, in the frequency
domain; elevation enters through the factor of `elevation.py` at every element's own distance.
"""

from __future__ import annotations

import math

import numba
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float32]

FAST_MATH = {"contract", "reassoc", "nsz", "arcp", "nnan", "ninf"}
LANES = 16  # frequencies that are computed at once; every number of frequencies is a multiple of it


@numba.njit(fastmath=FAST_MATH, nogil=True, error_model="numpy", cache=True)
def one_way(
    u: float,
    z: float,
    focal_depth: float,
    offset: float,
    apodization: npt.NDArray[np.float64],
    pitch: float,
    width: float,
    speed_of_sound: float,
    first_frequency: float,
    frequency_step: float,
    elevation_real: Floats,
    elevation_imag: Floats,
    distance_step: float,
    real: Floats,
    imag: Floats,
    lane_real: Floats,
    lane_imag: Floats,
) -> None:
    """Compute the response of one line's aperture at a point, without its geometric delay hypot(u, z) / c.

    H(f) = sum_n w_n / r_n * sinc(f width (u - e_n) / (r_n c)) * E(r_n; f)
                 * exp(-j 2 pi f ((r_n - hypot(u, z)) + F - hypot(e_n, F)) / c)

    Args:
        u: Lateral position of the point relative to the line, m.
        z: Depth of the point, m.
        focal_depth: F, m; the focus lies on the line.
        offset: Line position minus centre of the active aperture, m.
        apodization: w_n, (n_active,).
        pitch: Distance between elements, m.
        width: Width of an element, m.
        speed_of_sound: c, m/s.
        first_frequency: Hz.
        frequency_step: Hz.
        elevation_real: E at (n_distances, n_frequencies), real part.
        elevation_imag: The same, imaginary part.
        distance_step: Between the rows of E, m.
        real: Receives the real part of H, (n_frequencies,).
        imag: Receives the imaginary part of H, (n_frequencies,).
        lane_real: Scratch, (LANES,).
        lane_imag: Scratch, (LANES,).
    """
    n_active, n_frequencies = apodization.shape[0], real.shape[0]
    reference = math.sqrt(u * u + z * z)
    last_frequency = first_frequency + frequency_step * n_frequencies
    real[:] = 0.0
    imag[:] = 0.0
    for n in range(n_active):
        element = (n - (n_active - 1) * 0.5) * pitch - offset
        dx = u - element
        r = math.sqrt(dx * dx + z * z)
        delay = (r - reference + focal_depth - math.sqrt(focal_depth**2 + element * element)) / speed_of_sound

        # The sinc is so smooth over the band that a parabola through three frequencies gives it.
        slope = math.pi * width * abs(dx) / (r * speed_of_sound) + 1e-15
        a0, a2 = slope * first_frequency, slope * last_frequency
        a1 = 0.5 * (a0 + a2)
        q0, q1, q2 = math.sin(a0) / a0, math.sin(a1) / a1, math.sin(a2) / a2
        gain, unit = apodization[n] / r, 1.0 / n_frequencies
        constant = np.float32(gain * q0)
        linear = np.float32(gain * unit * (4.0 * q1 - 3.0 * q0 - q2))
        square = np.float32(gain * unit * unit * (2.0 * q0 - 4.0 * q1 + 2.0 * q2))

        # exp(-j w_k t) as a product of two short recurrences, so that the inner loop is plain arithmetic.
        step = -2.0 * math.pi * frequency_step * delay
        start = -2.0 * math.pi * first_frequency * delay
        cosine, sine = math.cos(start), math.sin(start)
        step_cosine, step_sine = math.cos(step), math.sin(step)
        for k in range(LANES):
            lane_real[k] = cosine
            lane_imag[k] = sine
            cosine, sine = cosine * step_cosine - sine * step_sine, cosine * step_sine + sine * step_cosine
        step_cosine, step_sine = math.cos(step * LANES), math.sin(step * LANES)
        cosine, sine = 1.0, 0.0
        row = min(int(r / distance_step + 0.5), elevation_real.shape[0] - 1)
        for block in range(n_frequencies // LANES):
            c32, s32, first = np.float32(cosine), np.float32(sine), block * LANES
            for k in range(LANES):
                x = np.float32(first + k)
                weight = constant + x * (linear + x * square)
                p = weight * (lane_real[k] * c32 - lane_imag[k] * s32)
                q = weight * (lane_real[k] * s32 + lane_imag[k] * c32)
                e_real, e_imag = elevation_real[row, first + k], elevation_imag[row, first + k]
                real[first + k] += p * e_real - q * e_imag
                imag[first + k] += p * e_imag + q * e_real
            cosine, sine = cosine * step_cosine - sine * step_sine, cosine * step_sine + sine * step_cosine


@numba.njit(fastmath=FAST_MATH, nogil=True, error_model="numpy", cache=True)
def mean_distance(u, z, focal_depth, offset, apodization, pitch, width, speed_of_sound, frequency):
    """Return the distance from the point to the elements that it is heard through, at one frequency, in m.

    The elements' distances r_n weighted with their contributions h_n, Re(sum r_n h_n / sum h_n), within the
    range of r_n. Args as for `one_way`.
    """
    n_active = apodization.shape[0]
    total, first_moment = 0j, 0j
    nearest, farthest = 1e9, 0.0
    for n in range(n_active):
        element = (n - (n_active - 1) * 0.5) * pitch - offset
        dx = u - element
        r = math.sqrt(dx * dx + z * z)
        path = r - math.sqrt(focal_depth**2 + element * element)
        a = math.pi * width * abs(dx) / (r * speed_of_sound) * frequency + 1e-15
        angle = -2.0 * math.pi * frequency / speed_of_sound * path
        heard = apodization[n] / r * math.sin(a) / a * complex(math.cos(angle), math.sin(angle))
        total += heard
        first_moment += r * heard
        nearest, farthest = min(nearest, r), max(farthest, r)
    mean = (first_moment * total.conjugate()).real / (total.real**2 + total.imag**2 + 1e-30)
    return min(max(mean, nearest), farthest)


@numba.njit(fastmath=FAST_MATH, nogil=True, error_model="numpy", cache=True)
def fill_responses(
    u, depths, focal_depth, offset, apodization, pitch, width, speed_of_sound, frequencies, elevation_real,
    elevation_imag, distance_step, probe_steps, spectra, turns, distances,
):  # fmt: skip
    """Compute two-way responses on a grid, and how their phase advances with u, z and the aperture's offset.

    Args as for `one_way`, over u (n_u,) and depths (n_depths,); `probe_steps` (3,) m are small steps of u, z
    and offset; `spectra` (n_depths, n_u, n_frequencies) and `turns` (n_depths, n_u, 3), the phase's advance
    over each of them, and `distances` (n_depths, n_u) m receive the results.
    """
    n_frequencies = frequencies.shape[0]
    step = frequencies[1] - frequencies[0]
    first = n_frequencies // 2 - LANES // 2
    real, imag = np.empty(n_frequencies, np.float32), np.empty(n_frequencies, np.float32)
    real_near, imag_near = np.empty(LANES, np.float32), np.empty(LANES, np.float32)
    lane_real, lane_imag = np.empty(LANES, np.float32), np.empty(LANES, np.float32)
    for i in range(depths.shape[0]):
        for j in range(u.shape[0]):
            one_way(
                u[j], depths[i], focal_depth, offset, apodization, pitch, width, speed_of_sound,
                frequencies[0], step, elevation_real, elevation_imag, distance_step, real, imag,
                lane_real, lane_imag,
            )  # fmt: skip
            for k in range(n_frequencies):
                spectra[i, j, k] = complex(real[k] * real[k] - imag[k] * imag[k], 2 * real[k] * imag[k])
            distances[i, j] = mean_distance(
                u[j], depths[i], focal_depth, offset, apodization, pitch, width, speed_of_sound,
                frequencies[n_frequencies // 2],
            )  # fmt: skip
            for axis in range(3):
                one_way(
                    u[j] + (probe_steps[0] if axis == 0 else 0.0),
                    depths[i] + (probe_steps[1] if axis == 1 else 0.0),
                    focal_depth, offset + (probe_steps[2] if axis == 2 else 0.0), apodization, pitch, width,
                    speed_of_sound, frequencies[first], step, elevation_real[:, first:],
                    elevation_imag[:, first:], distance_step, real_near, imag_near, lane_real, lane_imag,
                )  # fmt: skip
                cosine, sine = 0.0, 0.0
                for k in range(LANES):
                    near = complex(real_near[k], imag_near[k])
                    advance = near * near * spectra[i, j, first + k].conjugate()
                    cosine += advance.real
                    sine += advance.imag
                turns[i, j, axis] = np.arctan2(sine, cosine) / (2 * np.pi)
