"""Noise of the receiver's electronics: white and Gaussian, added to the I/Q before anything amplifies it.

Its level is stated against an echo that no frame changes: that of a unit point at REFERENCE_DEPTH on the axis
of the middle line, in tissue that does not attenuate, with transmit and receive focused on the point. With A
the largest envelope of this echo, each sample n of the I/Q is

    n = sigma / sqrt(2) (g_1 + j g_2),    sigma = A 10^(-noise_db / 20)

with g_1 and g_2 independent and standard normal: the noise has the root mean square sigma, the same at all
depths, focal depths and phantoms; where there is no echo the envelope has a Rayleigh distribution.
"""

from __future__ import annotations

import hashlib
from dataclasses import replace
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from usbench.envs.bmode import envelope
from usbench.envs.field.slow_sum import slow_rf
from usbench.envs.pose import Pose
from usbench.envs.probe import LinearArray
from usbench.words import in_words

# Of the point that noise is measured against, m: the middle of the paper's object.
REFERENCE_DEPTH = 50e-3


@lru_cache(maxsize=64)
def reference_amplitude(array: LinearArray) -> float:
    """Return the largest envelope of the reference's echo, in the units of simulated I/Q."""
    # An even number of elements, and of lines, has none in the middle: the line's own aperture is symmetric.
    middle = float(array.aperture_centers(np.zeros(1))[0])
    point = [(middle, 0.0, REFERENCE_DEPTH)]
    array = replace(array, receive_focus=None, receive_f_number=None)
    rf, _ = slow_rf(point, [1.0], array, REFERENCE_DEPTH, [middle])
    return float(envelope(rf).max())


def noise(
    shape: tuple[int, int], noise_db: float, array: LinearArray, tissue: object, pose: Pose
) -> npt.NDArray[np.complex64]:
    """Return the noise of an acquisition, (n_samples, n_lines), in the units of simulated I/Q.

    Args:
        shape: Of the I/Q, (n_samples, n_lines).
        noise_db: How far its root mean square lies below the reference's echo, dB.
        array: The transducer.
        tissue: What is examined; its `repr` says all that its echoes follow from.
        pose: Of the probe.

    Tissue, pose and array are the seed: an acquisition that is made again has the same noise, any other one
    has noise of its own. How the echoes are displayed is not in the seed.
    """
    rng = np.random.default_rng(seed(tissue, pose, array))
    parts = rng.standard_normal((*shape, 2), dtype=np.float32)
    size = reference_amplitude(array) * 10.0 ** (-noise_db / 20) / np.sqrt(2.0)
    return np.asarray((parts * np.float32(size)).view(np.complex64)[..., 0])


def seed(*acquisition: object) -> int:
    """Return the seed of what an acquisition is made of, the same in every process."""
    words = " ".join(map(in_words, acquisition))
    return int.from_bytes(hashlib.sha256(words.encode()).digest()[:16], "big")
