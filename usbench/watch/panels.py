"""The views of a picture side by side without the words around them: small, where these could not be read."""

import cv2
import numpy as np
import numpy.typing as npt

from usbench.envs.scene import picture
from usbench.envs.scene.drawing import BACKGROUND

# Rows of the picture with something to see, and columns between two views.
ROWS = (picture.TOP - 40, picture.BOTTOM)
GAP = 2


def side_by_side(
    scene: npt.NDArray[np.uint8], width: int, height: int
) -> tuple[npt.NDArray[np.uint8], dict[str, int]]:
    """Return the views of a picture as large as `width` x `height` pixels allow, and where each begins.

    Args:
        scene: What `draw_scene` returned.
        width: The most columns, at least 7.
        height: The most rows, at least 2.

    Returns:
        (rows, columns, 3) uint8 with an even number of rows, and the first column of every view by its title.
    """
    places = picture.panels(scene.shape[1])
    wide = sum(size for _, size in places.values())
    scale = min(height / (ROWS[1] - ROWS[0]), (width - 2 * GAP) / wide)
    n_rows = 2 * max(int((ROWS[1] - ROWS[0]) * scale / 2), 1)
    parts: list[npt.NDArray[np.uint8]] = []
    starts: dict[str, int] = {}
    for title, (left, size) in places.items():
        starts[title] = sum(part.shape[1] for part in parts)
        cut = scene[ROWS[0] : ROWS[1], left : left + size].copy()
        if left == picture.ABOVE_LEFT:  # the phantom is less wide than deep, and below it stands text
            cut[picture.TOP + size - ROWS[0] :] = BACKGROUND
        shape = (max(int(size * scale), 1), n_rows)
        parts += [
            np.asarray(cv2.resize(cut, shape, interpolation=cv2.INTER_AREA), dtype=np.uint8),
            np.zeros((n_rows, GAP, 3), np.uint8),
        ]
    return np.concatenate(parts[:-1], axis=1), starts
