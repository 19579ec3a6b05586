"""Eyes of the real frames: which poses the frames of phantoms cannot tell apart at their speckle.

Frames of training phantoms are reduced to the mean grey levels of blocks, moved to the depth of the object.
The frames of one relation of probe and object are taken for normally distributed, with a covariance that all
relations share (linear discriminant analysis, Fisher 1936). Two relations look alike where the best decision
between them, for a single frame, is wrong too often.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy import stats

from usbench.envs.ceilings.hypotheses import Hypotheses, Ints
from usbench.envs.frames import FrameStore
from usbench.envs.phantom import Phantom

Floats = npt.NDArray[np.float64]
BLOCK_PX = 5
_SHRINKAGE = 0.1  # of the covariance towards its diagonal
_LEAST = 3  # frames of a relation whose mean is trusted


def features(frame: npt.NDArray[np.uint8], depth_px: int) -> Floats:
    """Return the blocks of a frame around the depth of the object, standardised, (n_blocks,)."""
    height, width = frame.shape
    centred = np.roll(frame.astype(np.float64), height // 2 - depth_px, axis=0)
    rows, columns = height // BLOCK_PX, width // BLOCK_PX
    blocks = centred[: rows * BLOCK_PX, : columns * BLOCK_PX]
    values = blocks.reshape(rows, BLOCK_PX, columns, BLOCK_PX).mean(axis=(1, 3)).ravel()
    return np.asarray((values - values.mean()) / (values.std() + 1e-9))


def seen_by_real_eyes(
    known: Hypotheses, phantoms: Sequence[Phantom], stores: Sequence[FrameStore], error: float
) -> Hypotheses:
    """Return the hypotheses with the eyes of real frames.

    Args:
        known: With ideal eyes, whose classes are told apart here or not.
        phantoms: Of training.
        stores: Their frames.
        error: Probability of a wrong decision between two relations, below which they are told apart.
    """
    n_classes = int(known.seen.max()) + 1
    values, classes = _observed(known, phantoms, stores)
    counts = np.bincount(classes, minlength=n_classes)
    means = np.zeros((n_classes, values.shape[1]))
    np.add.at(means, classes, values)
    means /= np.maximum(counts, 1)[:, np.newaxis]
    rest = values - means[classes]
    covariance = rest.T @ rest / max(len(rest) - int(np.count_nonzero(counts)), 1)
    covariance = (1 - _SHRINKAGE) * covariance + _SHRINKAGE * np.diag(np.diag(covariance))
    whitened: Floats = np.linalg.solve(np.linalg.cholesky(covariance), means.T).T
    groups = _groups(whitened, counts >= _LEAST, -2 * stats.norm.ppf(error))
    return Hypotheses(known.task, known.targets, groups[known.seen])


def _observed(
    known: Hypotheses, phantoms: Sequence[Phantom], stores: Sequence[FrameStore]
) -> tuple[Floats, Ints]:
    """Return features of all frames (n, n_blocks), and their class with ideal eyes (n,)."""
    values, classes = [], []
    for phantom, store in zip(phantoms, stores, strict=True):
        target = phantom.target
        column = known.places[target.x_mm, target.angle_deg % 180]
        for row, pose in enumerate(known.task.states):
            values.append(features(store.frame(pose), target.focal_depth_mm))
            classes.append(int(known.seen[row, column]))
    return np.array(values), np.array(classes)


def _groups(whitened: Floats, trusted: npt.NDArray[np.bool_], distance: float) -> Ints:
    """Return a group for every class: that of the nearest earlier one within `distance`, or a new one.

    Classes of which there are too few frames keep a group of their own: they count as told apart.
    """
    leaders: list[int] = []
    groups = np.zeros(len(whitened), dtype=np.int64)
    n_groups = 0
    numbers: list[int] = []
    for k in range(len(whitened)):
        if trusted[k] and leaders:
            far = np.linalg.norm(whitened[leaders] - whitened[k], axis=1)
            if far.min() < distance:
                groups[k] = numbers[int(np.argmin(far))]
                continue
        groups[k] = n_groups
        if trusted[k]:
            leaders.append(k)
            numbers.append(n_groups)
        n_groups += 1
    return groups
