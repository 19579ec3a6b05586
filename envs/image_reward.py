"""A reward without the answer: how much a frame looks like the standard view, as a person would judge it.

The standard view is that of a textbook: the object from above its centre, in its plane and in focus, in a
phantom that is in no task. Nothing is known of where the probe or the object is.
"""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from usbench.envs.bmode import DEFAULT_IMAGING, Imaging
from usbench.envs.frames import frame_store
from usbench.envs.phantom import Phantom
from usbench.envs.probe import LinearArray

Frame = npt.NDArray[np.uint8]

# Phantoms of episodes have smaller seeds.
TEXTBOOK = Phantom(seed=2**32)
# The object's depths in its view, with a margin; speckle is smoothed away.
DEPTHS_MM = (20, 72)
SMOOTHING_MM = 2.0


def likeness(frame: Frame, view: Frame, imaging: Imaging = DEFAULT_IMAGING) -> float:
    """Return how alike a frame (height_px, width_px) and the standard view are, from -1 to 1.

    Contrast times structure of the structural similarity (Wang, Bovik, Sheikh and Simoncelli 2004, Eq. 9 and
    10, without constants), 2 cov(f, v) / (var f + var v), at the depth where it is largest: an object that
    lies deeper looks the same, further down. A frame as a whole being brighter makes no difference. Where
    neither shows anything, at any depth, they are 0 alike.
    """
    pixel_mm = 1e3 * imaging.pixel_size
    shown, wanted = (
        cv2.GaussianBlur(image.astype(np.float32), (0, 0), SMOOTHING_MM / pixel_mm).astype(np.float64)
        for image in (frame, view)
    )
    rows = slice(*(round(depth_mm / pixel_mm) for depth_mm in DEPTHS_MM))
    wanted = wanted[rows] - wanted[rows].mean()
    windows = np.lib.stride_tricks.sliding_window_view(shown, len(wanted), axis=0)  # (n_depths, width, rows)
    covariance = np.tensordot(windows, wanted.T, axes=2) / wanted.size
    variance = windows.var(axis=(1, 2)) + wanted.var()
    return float(np.max(2 * covariance / np.where(variance > 0, variance, 1.0)))


def check_depth(imaging: Imaging) -> None:
    """Raise ValueError if the image ends above the middle of the object in the standard view."""
    middle_mm = TEXTBOOK.target.focal_depth_mm
    if 1e3 * imaging.depth < middle_mm:
        raise ValueError(
            f"with the reward 'image' the image must be at least {middle_mm} mm deep, where the object of "
            f"the standard view is, not {1e3 * imaging.depth:g} mm."
        )


@lru_cache(maxsize=8)
def standard_view(array: LinearArray, imaging: Imaging) -> Frame:
    """Return the textbook's frame (height_px, width_px) for a transducer and its imaging, read-only."""
    store = frame_store(TEXTBOOK, array, imaging)
    store.prepare([TEXTBOOK.target])
    return store.frame(TEXTBOOK.target)
