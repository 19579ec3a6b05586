"""Shapes on an RGB image (height, width, 3) uint8; they may lie between pixels, and beyond the image."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

Image = npt.NDArray[np.uint8]
Color = tuple[int, int, int]
Point = tuple[float, float]

# Okabe and Ito's colours, which colour-blind people can tell apart.
BACKGROUND, PANEL_TOP, PANEL_BOTTOM = (15, 18, 24), (46, 50, 60), (26, 29, 36)
GRID, TEXT, FAINT_TEXT = (62, 67, 78), (226, 229, 234), (150, 156, 168)
BODY, LIMB, BEAM, FOCUS, METAL = (86, 180, 233), (213, 94, 0), (86, 200, 170), (240, 228, 66), (196, 202, 212)


def lit_ball(image: Image, center: Point, radius: float, color: Color) -> None:
    """Draw a ball lit from the upper left, with a soft edge."""
    rows, columns = np.ogrid[: image.shape[0], : image.shape[1]]
    x, y = (columns - center[0]) / radius, (rows - center[1]) / radius
    square = x**2 + y**2
    cover = np.clip((1 - np.sqrt(square)) * radius + 0.5, 0, 1)[..., np.newaxis]
    light = np.clip(0.78 * np.sqrt(np.clip(1 - square, 0, 1)) - 0.35 * x - 0.5 * y, 0, 1)[..., np.newaxis]
    shaded = np.asarray(color) * (0.45 + 0.55 * light)
    image[...] = (image * (1 - cover) + shaded * cover).astype(np.uint8)


def _fixed(point: Point) -> tuple[int, int]:
    """Return a point in the 1/16 pixels of OpenCV's `shift=4`, so that slow motion does not jump."""
    return round(point[0] * 16), round(point[1] * 16)


def line(image: Image, start: Point, end: Point, color: Color, thickness: int = 1) -> None:
    """Draw a straight line."""
    cv2.line(image, _fixed(start), _fixed(end), color, thickness, cv2.LINE_AA, 4)


def dot(image: Image, center: Point, radius: float, color: Color) -> None:
    """Draw a disc."""
    cv2.circle(image, _fixed(center), round(radius * 16), color, -1, cv2.LINE_AA, 4)


def cross(image: Image, center: Point) -> None:
    """Mark the focal point, with a dark rim to stand out from anything."""
    x, y = center
    for color, thickness in ((BACKGROUND, 5), (FOCUS, 2)):
        line(image, (x - 8, y), (x + 8, y), color, thickness)
        line(image, (x, y - 8), (x, y + 8), color, thickness)


def polygon(
    image: Image, corners: Sequence[Point], color: Color, alpha: float, outline: bool = False
) -> None:
    """Fill a convex polygon with a see-through colour."""
    points = np.array([_fixed(corner) for corner in corners], np.int32)
    (left, top), (right, bottom) = points.min(axis=0) // 16, points.max(axis=0) // 16 + 1
    region = image[max(top, 0) : max(bottom + 1, 0), max(left, 0) : max(right + 1, 0)]
    if not region.size:
        return
    overlay = region.copy()
    shifted = points - 16 * np.maximum([left, top], 0).astype(np.int32)
    cv2.fillConvexPoly(overlay, shifted, color, cv2.LINE_AA, 4)
    cv2.addWeighted(overlay, alpha, region, 1 - alpha, 0, dst=overlay)
    region[...] = overlay
    if outline:
        cv2.polylines(image, [points], True, color, 1, cv2.LINE_AA, 4)


def text(
    image: Image,
    words: str,
    origin: Point,
    color: Color,
    size: float,
    *,
    bold: bool = False,
    align: float = 0.0,
) -> None:
    """Write text on its base line; `align` is the part of its width that lies left of `origin`."""
    thickness = 2 if bold else 1
    (width, _), _ = cv2.getTextSize(words, cv2.FONT_HERSHEY_SIMPLEX, size, thickness)
    position = round(origin[0] - align * width), round(origin[1])
    cv2.putText(image, words, position, cv2.FONT_HERSHEY_SIMPLEX, size, color, thickness, cv2.LINE_AA)
