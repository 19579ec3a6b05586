"""One-way fields of the receiving aperture, where its focus and width are others than those of the transmit.

A receive focus follows the echoes or not, and a receive aperture grows with it: its delays and its window
depend on the depth R of the focus. A dynamic focus lies at the distance of the point at (u, z) from the
line's reference point, R = hypot(u, z). So the sum of `aperture.py` is no convolution, and is written out at
every node of the table:

    G_m(u, z; f) = sum_n v_n(R) exp(-j 2 pi f (R - hypot(e_n, R)) / c) g(u - e_n, z; f) exp(-2 pi j m n / K)/K

over positions e_n of K to a pitch, with v the window about the line and g the field of an element.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numba
import numpy as np

from usbench.envs.field.aperture import Aperture, Floats, Spectra
from usbench.envs.field.elevation import FAST_MATH


@dataclass(frozen=True)
class Receiving:
    """What the field of a line's receiving aperture is made of.

    Attributes:
        transmit: The aperture that fires, on the same grids.
        focal_depth: Of the transmit, m.
        oversampling: K, positions per pitch.
        distance: By how much all u are moved, m.
    """

    transmit: Aperture
    focal_depth: float
    oversampling: int
    distance: float = 0.0

    def only(self, which: slice) -> Receiving:
        """Return the same for some of the frequencies."""
        return replace(self, transmit=self.transmit.only(which))

    def moved(self, distance: float) -> Receiving:
        """Return what has at u the field of u + `distance` (m)."""
        return replace(self, distance=self.distance + distance)

    def fields(self, depths: Floats, moment: bool = False) -> Spectra:
        """Return G_m at `depths` (m), (n_orders, n_depths, n_u, n_frequencies); with `moment`, of r g."""
        one, array, k = self.transmit, self.transmit.array, self.oversampling
        element = one.element_fields(depths, moment, self.distance)
        n_depths, n_f, n_x = element.shape
        # Positions that are a pitch apart lie together: element (n_depths, n_frequencies, K, n_x / K).
        padded = np.zeros((n_depths, n_f, -(-n_x // k) * k), dtype=np.complex64)
        padded[..., :n_x] = element
        parted = np.ascontiguousarray(padded.reshape(n_depths, n_f, -1, k).swapaxes(2, 3))
        u = one.u + self.distance
        foci = array.receive_depths(self.focal_depth, np.hypot(u, depths[:, np.newaxis]))
        half = array.receive_half_width(foci)
        n = (array.n_active + 1) * k - 1
        positions = (np.arange(n) - (n - 1) / 2) * (array.pitch / k)
        turns = np.outer(one.orders, np.arange(k)) / k
        combs = (np.exp(-2j * np.pi * turns) / k).astype(np.complex64)
        fields = np.zeros((len(one.orders), n_depths, len(u), n_f), dtype=np.complex64)
        wave_numbers = one.frequencies / array.speed_of_sound
        for i in range(n_depths):
            parts = np.ascontiguousarray(parted[i].real), np.ascontiguousarray(parted[i].imag)
            _add_positions(*parts, positions, foci[i], half[i], one.stride, wave_numbers, combs, fields[:, i])
        return fields


@numba.njit(fastmath=FAST_MATH, nogil=True, error_model="numpy", cache=True)
def _hann(part):
    """Return the Hann window at a `part` of its half width."""
    return 0.5 * (1.0 + np.cos(np.pi * part))


@numba.njit(fastmath=FAST_MATH, nogil=True, error_model="numpy", cache=True)
def _add_positions(real, imaginary, positions, foci, half, stride, wave_numbers, combs, fields):
    """Add the sums over `positions` (n,) to `fields` (n_orders, n_u, n_frequencies), at one depth.

    The element's field is in two parts, (n_frequencies, K, n_x / K).
    """
    n_f, k_parts, n_q = real.shape
    n, last = positions.shape[0], positions.shape[0] - 1
    c, s, turn_c, turn_s = np.empty((4, n // k_parts + 2), np.float32)
    first_k, step = wave_numbers[0], (wave_numbers[-1] - wave_numbers[0]) / max(n_f - 1, 1)
    for j in range(fields.shape[1]):
        depth, base = foci[j], stride * j + last  # position m meets the element's field at base - m
        for part in range(k_parts):
            low, count = -1, 0
            for q in range(max(0, (base - last - part + k_parts - 1) // k_parts), n_q):
                m = base - (part + k_parts * q)
                if m < 0:
                    break
                e = positions[m]
                if m > last or abs(e) >= half[j]:
                    continue
                if count == 0:
                    low = q
                weight = _hann(e / half[j])
                ahead = 2.0 * np.pi * (np.hypot(e, depth) - depth)
                c[count], s[count] = weight * np.cos(ahead * first_k), weight * np.sin(ahead * first_k)
                turn_c[count], turn_s[count] = np.cos(ahead * step), np.sin(ahead * step)
                count += 1
            if count == 0:
                continue
            comb = (base - part - low * k_parts - (k_parts - 1)) % k_parts
            for k in range(n_f):
                total_c, total_s = np.float32(0), np.float32(0)
                for q in range(count):
                    a, b = real[k, part, low + q], imaginary[k, part, low + q]
                    total_c += c[q] * a - s[q] * b
                    total_s += c[q] * b + s[q] * a
                    next_c = c[q] * turn_c[q] - s[q] * turn_s[q]
                    s[q] = c[q] * turn_s[q] + s[q] * turn_c[q]
                    c[q] = next_c
                for order in range(fields.shape[0]):
                    fields[order, j, k] += combs[order, comb] * complex(total_c, total_s)
