"""What the tests of the RF share: echoes of single points, and the correlation of two signals."""

import math

import numpy as np

from usbench.envs.probe import LinearArray
from usbench.envs.rf import simulate_iq

ARRAY = LinearArray()
SMALL = {"n_elements": 96, "n_active": 24}  # its tables are smaller

# A few scatterers for the tests that compare every sample.
CLOUD = np.random.default_rng(6).uniform([-0.012, -0.0025, 0.015], [0.012, 0.0025, 0.07], (14, 3))
WEIGHTS = np.random.default_rng(7).normal(size=14)


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
