"""A reward without the answer: how much a frame looks like the standard view, as a person would judge it.

The standard view is that of a textbook: the object from above its centre, in its plane and in focus, in a
phantom that is in no task. Nothing is known of where the probe or the object is.
"""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from usbench.envs.bmode import Imaging
from usbench.envs.frames import frame_store
from usbench.envs.phantom import Phantom
from usbench.envs.probe import LinearArray

Frame = npt.NDArray[np.uint8]

# Phantoms of episodes have smaller seeds.
TEXTBOOK = Phantom(seed=2**32)
# The object's rows in its view, with a margin; speckle is smoothed away, px.
ROWS = slice(20, 72)
SMOOTHING = 2.0


def likeness(frame: Frame, view: Frame) -> float:
    """Return how alike a frame (height_px, width_px) and the standard view are, from -1 to 1.

    Contrast times structure of the structural similarity (Wang, Bovik, Sheikh and Simoncelli 2004, Eq. 9 and
    10, without constants), 2 cov(f, v) / (var f + var v), at the depth where it is largest: an object that
    lies deeper looks the same, further down. A frame as a whole being brighter makes no difference.
    """
    shown, wanted = (
        cv2.GaussianBlur(image.astype(np.float32), (0, 0), SMOOTHING).astype(np.float64)
        for image in (frame, view)
    )
    wanted = wanted[ROWS] - wanted[ROWS].mean()
    windows = np.lib.stride_tricks.sliding_window_view(shown, len(wanted), axis=0)  # (n_depths, width, rows)
    covariance = np.tensordot(windows, wanted.T, axes=2) / wanted.size
    return float(np.max(2 * covariance / (windows.var(axis=(1, 2)) + wanted.var())))


@lru_cache(maxsize=8)
def standard_view(array: LinearArray, imaging: Imaging) -> Frame:
    """Return the textbook's frame (height_px, width_px) for a transducer and its imaging, read-only."""
    store = frame_store(TEXTBOOK, array, imaging)
    store.prepare([TEXTBOOK.target])
    return store.frame(TEXTBOOK.target)
