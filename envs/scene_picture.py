"""The picture of an examination: phantom, probe and image plane from above and from the side, and the frame.

All three views share one scale, and the side view and the frame share their depth axis.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from usbench.envs.phantom import ObjectOfInterest
from usbench.envs.pose import Pose, cos_deg, sin_deg
from usbench.envs.settings import in_words
from usbench.envs.tissue import Tissue

Image = npt.NDArray[np.uint8]
Color = tuple[int, int, int]
Point = tuple[float, float]

HEIGHT, WIDTH = 580, 1240  # pixels, even as video encoders want them
VIEW, DEPTH_VIEW = 400, 450  # pixels for the phantom's width and depth: 5 per mm of the default phantom
TOP, BOTTOM = 84, 84 + DEPTH_VIEW
ABOVE_LEFT, SIDE_LEFT, FRAME_LEFT = 50, 526, 1000
FRAME_SCALE = 5  # pixels per mm of the frame
PROBE_MM, SLAB_MM, APERTURE_MM = 40.0, 10.0, 31.0  # array, thickness of what it sees, active aperture

# Okabe and Ito's colours, which colour-blind people can tell apart.
BACKGROUND, PANEL_TOP, PANEL_BOTTOM = (15, 18, 24), (46, 50, 60), (26, 29, 36)
GRID, TEXT, FAINT_TEXT = (62, 67, 78), (226, 229, 234), (150, 156, 168)
BODY, LIMB, BEAM, FOCUS, METAL = (86, 180, 233), (213, 94, 0), (86, 200, 170), (240, 228, 66), (196, 202, 212)


def draw_scene(
    phantom: Tissue, pose: Pose, frame: Image, *, show_object: bool = True, caption: str = ""
) -> Image:
    """Return the scene beside the frame, (580, 1220, 3) uint8 RGB.

    Args:
        phantom: What is examined.
        pose: Where the probe is.
        frame: The B-mode frame seen from there, (90, 40) uint8.
        show_object: Whether to draw the object, in a custom anatomy the image plane that shows it
            best; in a real examination nobody sees it.
        caption: A line of text below, for example the step and the action.
    """
    image = _background(phantom, bool(show_object)).copy()
    _draw_above(image, phantom, pose)
    _draw_side(image, phantom, pose)
    _draw_frame(image, pose, frame)
    where = [f"x {_signed(pose.x_mm)} mm", f"focus {pose.focal_depth_mm} mm", f"angle {pose.angle_deg}\u00b0"]
    readout = (" " * 6).join([*where, *in_words(pose)])
    _text(image, readout, (ABOVE_LEFT, BOTTOM - 4), TEXT, 0.5, bold=True)
    _text(image, caption, (ABOVE_LEFT, BOTTOM + 22), FAINT_TEXT, 0.48)
    return image


def _scale(phantom: Tissue) -> float:
    """Return pixels per mm of the two scene views."""
    return min(VIEW / phantom.width_mm, VIEW / phantom.height_mm, DEPTH_VIEW / phantom.depth_mm)


@lru_cache(maxsize=8)
def _background(phantom: Tissue, show_object: bool) -> Image:
    """Draw all that does not change while the probe moves."""
    image = np.full((HEIGHT, WIDTH, 3), BACKGROUND, np.uint8)
    scale = _scale(phantom)
    width, height, depth = (scale * mm for mm in (phantom.width_mm, phantom.height_mm, phantom.depth_mm))
    _panel(image, ABOVE_LEFT, width, height, "From above", "x, y in mm")
    _panel(image, SIDE_LEFT, width, depth, "From the side", "x, z in mm")
    _panel(image, FRAME_LEFT, PROBE_MM * FRAME_SCALE, DEPTH_VIEW, "B-mode frame", "mm")
    for mm in range(-40, 41, 20):
        for left, bottom in ((ABOVE_LEFT, height), (SIDE_LEFT, depth)):
            x = left + width / 2 + mm * scale
            if left <= x <= left + width:
                _line(image, (x, TOP), (x, TOP + bottom), GRID)
                _text(image, _signed(mm), (x, TOP + bottom + 18), FAINT_TEXT, 0.4, align=0.5)
        y = TOP + height / 2 + mm * scale
        if TOP <= y <= TOP + height:
            _line(image, (ABOVE_LEFT, y), (ABOVE_LEFT + width, y), GRID)
            _text(image, _signed(mm), (ABOVE_LEFT - 8, y + 4), FAINT_TEXT, 0.4, align=1)
    for mm in range(0, int(phantom.depth_mm) + 1, 10):
        y = TOP + mm * scale
        _line(image, (SIDE_LEFT, y), (SIDE_LEFT + width, y), GRID)
        _text(image, str(mm), (SIDE_LEFT - 8, y + 4), FAINT_TEXT, 0.4, align=1)
    for mm in range(0, 91, 10):
        _text(image, str(mm), (FRAME_LEFT - 8, TOP + mm * FRAME_SCALE + 4), FAINT_TEXT, 0.4, align=1)
    for mm in (-20, 0, 20):
        x = FRAME_LEFT + (mm + PROBE_MM / 2) * FRAME_SCALE
        _text(image, _signed(mm), (x, BOTTOM + 18), FAINT_TEXT, 0.4, align=0.5)
    if show_object:
        if phantom.object_of_interest is None:
            _draw_target(image, phantom)
        else:
            _draw_object(image, phantom, phantom.object_of_interest)
    image.flags.writeable = False
    return image


def _panel(image: Image, left: int, width: float, height: float, title: str, unit: str) -> None:
    """Fill a panel, darker with depth, and write its title above."""
    rows, columns = round(height), round(width)
    ramp = np.linspace(PANEL_TOP, PANEL_BOTTOM, rows)[:, np.newaxis, :]
    image[TOP : TOP + rows, left : left + columns] = ramp.astype(np.uint8)
    _text(image, title, (left, 30), TEXT, 0.6, bold=True)
    _text(image, unit, (left + width, 30), FAINT_TEXT, 0.42, align=1)


def _ball(image: Image, center: Point, radius: float, color: Color) -> None:
    """Draw a ball lit from the upper left, with a soft edge."""
    rows, columns = np.ogrid[: image.shape[0], : image.shape[1]]
    x, y = (columns - center[0]) / radius, (rows - center[1]) / radius
    square = x**2 + y**2
    cover = np.clip((1 - np.sqrt(square)) * radius + 0.5, 0, 1)[..., np.newaxis]
    light = np.clip(0.78 * np.sqrt(np.clip(1 - square, 0, 1)) - 0.35 * x - 0.5 * y, 0, 1)[..., np.newaxis]
    shaded = np.asarray(color) * (0.45 + 0.55 * light)
    image[...] = (image * (1 - cover) + shaded * cover).astype(np.uint8)


def _draw_object(image: Image, phantom: Tissue, shown: ObjectOfInterest) -> None:
    """Draw the balls in both views, the nearest last."""
    scale, balls = _scale(phantom), list(enumerate(shown.balls))
    middles = ((2, ABOVE_LEFT, phantom.height_mm / 2 * scale, 1), (1, SIDE_LEFT, 0.0, 2))
    for nearest_last, left, middle, axis in middles:
        for index, ball in sorted(balls, key=lambda item: -item[1].center_mm[nearest_last]):
            center = (
                left + (phantom.width_mm / 2 + ball.center_mm[0]) * scale,
                TOP + middle + ball.center_mm[axis] * scale,
            )
            _ball(image, center, ball.radius_mm * scale, BODY if index == 0 else LIMB)


def _draw_target(image: Image, phantom: Tissue) -> None:
    """Draw the image plane of the target from above, a line, and from the side."""
    scale, target = _scale(phantom), phantom.target
    middle, half = (phantom.width_mm / 2 + target.x_mm) * scale, PROBE_MM / 2 * scale
    along, across = half * cos_deg(target.angle_deg), half * sin_deg(target.angle_deg)
    x, y = ABOVE_LEFT + middle, TOP + phantom.height_mm / 2 * scale
    _line(image, (x - along, y - across), (x + along, y + across), BODY, 4)
    x, width, bottom = SIDE_LEFT + middle, max(abs(along), 2.0), TOP + phantom.depth_mm * scale
    corners = [(x - width, TOP), (x + width, TOP), (x + width, bottom), (x - width, bottom)]
    _polygon(image, corners, BODY, 0.35, outline=True)


def _draw_above(image: Image, phantom: Tissue, pose: Pose) -> None:
    """Draw the probe's footprint, its image plane (a line from here) and the focal point."""
    scale = _scale(phantom)
    center = (
        ABOVE_LEFT + (phantom.width_mm / 2 + pose.x_mm) * scale,
        TOP + phantom.height_mm / 2 * scale,
    )
    cosine, sine = cos_deg(pose.angle_deg), sin_deg(pose.angle_deg)

    def at(along_mm: float, across_mm: float) -> Point:
        x, y = cosine * along_mm - sine * across_mm, sine * along_mm + cosine * across_mm
        return center[0] + x * scale, center[1] + y * scale

    half, slab = PROBE_MM / 2, SLAB_MM / 2
    _polygon(
        image, [at(-half, -slab), at(half, -slab), at(half, slab), at(-half, slab)], BEAM, 0.3, outline=True
    )
    _line(image, at(-half, 0), at(half, 0), BEAM, 2)
    _dot(image, at(-half + 2.5, -slab + 2.2), 4, METAL)
    _cross(image, center)


def _draw_side(image: Image, phantom: Tissue, pose: Pose) -> None:
    """Draw the probe on the skin, its image plane as seen from the side, the beam and the focal point."""
    scale = _scale(phantom)
    center, bottom = SIDE_LEFT + (phantom.width_mm / 2 + pose.x_mm) * scale, TOP + phantom.depth_mm * scale
    focus = TOP + pose.focal_depth_mm * scale
    cosine, sine = cos_deg(pose.angle_deg), sin_deg(pose.angle_deg)
    half = abs(cosine) * PROBE_MM / 2 * scale
    slab = half + abs(sine) * SLAB_MM / 2 * scale  # what is seen has a thickness, which shows from aside
    corners = [(center - slab, TOP), (center + slab, TOP), (center + slab, bottom), (center - slab, bottom)]
    _polygon(image, corners, BEAM, 0.14, outline=True)
    aperture = APERTURE_MM / 2 * abs(cosine) * scale
    reach = min(1.0, (bottom - focus) / max(focus - TOP, 1.0))
    _polygon(image, [(center - aperture, TOP), (center + aperture, TOP), (center, focus)], BEAM, 0.22)
    foot = focus + (focus - TOP) * reach
    spread = aperture * reach
    _polygon(image, [(center, focus), (center + spread, foot), (center - spread, foot)], BEAM, 0.22)
    _line(image, (center - slab, focus), (center + slab, focus), FOCUS)

    shell = slab + scale
    handle = 0.72 * shell
    outline = [(center - handle, TOP - 38), (center + handle, TOP - 38), (center + shell, TOP - 12)]
    outline += [(center + shell, TOP), (center - shell, TOP), (center - shell, TOP - 12)]
    _polygon(image, outline, METAL, 1.0)
    _line(image, (center - slab, TOP - 1), (center + slab, TOP - 1), BEAM, 3)
    marker = center - cosine * (PROBE_MM / 2 - 2.5) * scale
    _dot(image, (marker, TOP - 10), 4, BACKGROUND)
    _cross(image, (center, focus))


def _draw_frame(image: Image, pose: Pose, frame: Image) -> None:
    """Draw the frame enlarged, with the probe's orientation mark and the depth of the focus."""
    if frame.shape != (90, 40) or frame.dtype != np.uint8:
        raise ValueError(f"frame must be (90, 40) uint8, not {frame.shape} {frame.dtype}.")
    width, height = 40 * FRAME_SCALE, 90 * FRAME_SCALE
    enlarged = cv2.resize(frame, (width, height), interpolation=cv2.INTER_CUBIC)
    image[TOP : TOP + height, FRAME_LEFT : FRAME_LEFT + width] = enlarged[:, :, np.newaxis]
    _dot(image, (FRAME_LEFT + 2.5 * FRAME_SCALE, TOP - 10), 4, METAL)
    right, focus = FRAME_LEFT + width + 5, TOP + pose.focal_depth_mm * FRAME_SCALE
    _polygon(image, [(right, focus), (right + 12, focus - 7), (right + 12, focus + 7)], FOCUS, 1.0)


def _signed(number: int) -> str:
    """Return the number with a sign, 0 without."""
    return f"{number:+d}".replace("-", "\u2212") if number else "0"


def _fixed(point: Point) -> tuple[int, int]:
    """Return a point in the 1/16 pixels of OpenCV's `shift=4`, so that slow motion does not jump."""
    return round(point[0] * 16), round(point[1] * 16)


def _line(image: Image, start: Point, end: Point, color: Color, thickness: int = 1) -> None:
    cv2.line(image, _fixed(start), _fixed(end), color, thickness, cv2.LINE_AA, 4)


def _dot(image: Image, center: Point, radius: float, color: Color) -> None:
    cv2.circle(image, _fixed(center), round(radius * 16), color, -1, cv2.LINE_AA, 4)


def _cross(image: Image, center: Point) -> None:
    """Mark the focal point, with a dark rim to stand out from anything."""
    x, y = center
    for color, thickness in ((BACKGROUND, 5), (FOCUS, 2)):
        _line(image, (x - 8, y), (x + 8, y), color, thickness)
        _line(image, (x, y - 8), (x, y + 8), color, thickness)


def _polygon(
    image: Image, corners: Sequence[Point], color: Color, alpha: float, outline: bool = False
) -> None:
    """Fill a convex polygon with a see-through colour."""
    points = np.array([_fixed(corner) for corner in corners], np.int32)
    (left, top), (right, bottom) = points.min(axis=0) // 16, points.max(axis=0) // 16 + 1
    region = image[max(top, 0) : bottom + 1, max(left, 0) : right + 1]
    overlay = region.copy()
    shifted = points - 16 * np.maximum([left, top], 0).astype(np.int32)
    cv2.fillConvexPoly(overlay, shifted, color, cv2.LINE_AA, 4)
    cv2.addWeighted(overlay, alpha, region, 1 - alpha, 0, dst=overlay)
    region[...] = overlay
    if outline:
        cv2.polylines(image, [points], True, color, 1, cv2.LINE_AA, 4)


def _text(
    image: Image,
    text: str,
    origin: Point,
    color: Color,
    size: float,
    *,
    bold: bool = False,
    align: float = 0.0,
) -> None:
    """Write text on its base line; `align` is the part of its width that lies left of `origin`."""
    thickness = 2 if bold else 1
    (width, _), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, size, thickness)
    position = round(origin[0] - align * width), round(origin[1])
    cv2.putText(image, text, position, cv2.FONT_HERSHEY_SIMPLEX, size, color, thickness, cv2.LINE_AA)
