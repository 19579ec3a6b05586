"""The picture of an examination: phantom, probe and image plane from above and from the side, and the frame.

With the default phantom and imaging all three views share one scale.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from usbench.envs.bmode import DEFAULT_IMAGING, Imaging
from usbench.envs.phantom import ObjectOfInterest
from usbench.envs.pose import Pose, cos_deg, sin_deg
from usbench.envs.probe import DEFAULT_ARRAY, LinearArray
from usbench.envs.scene.drawing import (
    BACKGROUND,
    BEAM,
    BODY,
    FAINT_TEXT,
    FOCUS,
    GRID,
    LIMB,
    METAL,
    PANEL_BOTTOM,
    PANEL_TOP,
    TEXT,
    Image,
    Point,
    cross,
    dot,
    line,
    lit_ball,
    polygon,
    text,
)
from usbench.envs.settings import in_words
from usbench.envs.tissue import Tissue

HEIGHT = 580  # pixels; even, as is every width, since video encoders want it so
VIEW, DEPTH_VIEW = 400, 450  # pixels for the phantom's width and depth: 5 per mm of the default phantom
TOP, BOTTOM = 84, 84 + DEPTH_VIEW
ABOVE_LEFT, SIDE_LEFT, FRAME_LEFT, RIGHT_MARGIN = 50, 526, 1000, 40
# Of small letters, in the unit of OpenCV: 16 pixels high, 9 where a page shows the picture 720 wide.
SMALL = 0.5
WIDEST_FRAME = 600  # pixels; a frame is as high as the side view, unless it would be wider


@dataclass(frozen=True)
class Probe:
    """What is drawn of a probe, in mm.

    Attributes:
        width: What the scan lines cover.
        slab: Thickness of what they see.
        aperture: Of the elements that fire for one line, in whole mm.
    """

    width: float
    slab: float
    aperture: float

    @classmethod
    def of(cls, array: LinearArray) -> Probe:
        """Return what is drawn of `array`."""
        return cls(1e3 * array.width, 1e3 * array.slice_thickness, round(1e3 * array.aperture_width))


def draw_scene(
    phantom: Tissue,
    pose: Pose,
    frame: Image,
    array: LinearArray = DEFAULT_ARRAY,
    imaging: Imaging = DEFAULT_IMAGING,
    *,
    show_object: bool = True,
    caption: str = "",
) -> Image:
    """Return the scene beside the frame, (580, width, 3) uint8 RGB; with the default imaging 1240 wide.

    Args:
        phantom: What is examined.
        pose: Where the probe is.
        frame: The B-mode frame seen from there, (height_px, width_px) uint8.
        array: The transducer.
        imaging: Size of the frame.
        show_object: Whether to draw the object, in a custom anatomy the image plane that shows it best; in a
            real examination nobody sees it.
        caption: A line of text below, for example the step and the action.

    Raises:
        ValueError: If the frame has another size than `imaging` says.
    """
    probe = Probe.of(array)
    image = _background(phantom, probe, imaging, bool(show_object)).copy()
    _draw_above(image, phantom, pose, probe)
    _draw_side(image, phantom, pose, probe)
    _draw_frame(image, pose, frame, imaging)
    where = [f"x {_signed(pose.x_mm)} mm", f"focus {pose.focal_depth_mm} mm", f"angle {pose.angle_deg}\u00b0"]
    readout = (" " * 6).join([*where, *in_words(pose)])
    text(image, readout, (ABOVE_LEFT, BOTTOM - 4), TEXT, SMALL, bold=True)
    text(image, caption, (ABOVE_LEFT, BOTTOM + 22), FAINT_TEXT, SMALL)
    return image


def panels(picture_width: int) -> dict[str, tuple[int, int]]:
    """Return left edge and width (pixels) of every panel by its title, in a picture of this width."""
    return {
        "From above": (ABOVE_LEFT, VIEW),
        "From the side": (SIDE_LEFT, VIEW),
        "B-mode frame": (FRAME_LEFT, picture_width - FRAME_LEFT - RIGHT_MARGIN),
    }


def _scale(phantom: Tissue) -> float:
    """Return pixels per mm of the two scene views."""
    return min(VIEW / phantom.width_mm, VIEW / phantom.height_mm, DEPTH_VIEW / phantom.depth_mm)


def _frame_scale(imaging: Imaging) -> float:
    """Return pixels per mm of the frame."""
    return min(DEPTH_VIEW / (1e3 * imaging.depth), WIDEST_FRAME / (1e3 * imaging.width))


def _frame_size(imaging: Imaging) -> tuple[int, int]:
    """Return height and width of the enlarged frame, pixels."""
    scale = _frame_scale(imaging)
    return max(1, round(1e3 * imaging.depth * scale)), max(2, 2 * round(1e3 * imaging.width * scale / 2))


@lru_cache(maxsize=8)
def _background(phantom: Tissue, probe: Probe, imaging: Imaging, show_object: bool) -> Image:
    """Draw all that does not change while the probe moves."""
    frame_height, frame_width = _frame_size(imaging)
    image = np.full((HEIGHT, FRAME_LEFT + frame_width + RIGHT_MARGIN, 3), BACKGROUND, np.uint8)
    scale = _scale(phantom)
    width, height, depth = (scale * mm for mm in (phantom.width_mm, phantom.height_mm, phantom.depth_mm))
    _panel(image, ABOVE_LEFT, width, height, "From above", "x, y in mm")
    _panel(image, SIDE_LEFT, width, depth, "From the side", "x, z in mm")
    _panel(image, FRAME_LEFT, frame_width, frame_height, "B-mode frame", "mm")
    _draw_grid(image, phantom)
    _draw_rulers(image, imaging)
    if show_object:
        if phantom.object_of_interest is None:
            _draw_target(image, phantom, probe)
        else:
            _draw_object(image, phantom, phantom.object_of_interest)
    image.flags.writeable = False
    return image


def _draw_grid(image: Image, phantom: Tissue) -> None:
    """Draw the lines of the phantom's coordinates in both views, and their numbers."""
    scale = _scale(phantom)
    width, height, depth = (scale * mm for mm in (phantom.width_mm, phantom.height_mm, phantom.depth_mm))
    reach = int(max(phantom.width_mm, phantom.height_mm) / 2) // 20 * 20
    for mm in range(-reach, reach + 1, 20):
        for left, bottom in ((ABOVE_LEFT, height), (SIDE_LEFT, depth)):
            x = left + width / 2 + mm * scale
            if left <= x <= left + width:
                line(image, (x, TOP), (x, TOP + bottom), GRID)
                text(image, _signed(mm), (x, TOP + bottom + 18), FAINT_TEXT, SMALL, align=0.5)
        y = TOP + height / 2 + mm * scale
        if TOP <= y <= TOP + height:
            line(image, (ABOVE_LEFT, y), (ABOVE_LEFT + width, y), GRID)
            text(image, _signed(mm), (ABOVE_LEFT - 8, y + 4), FAINT_TEXT, SMALL, align=1)
    for mm in range(0, int(phantom.depth_mm) + 1, 10):
        y = TOP + mm * scale
        line(image, (SIDE_LEFT, y), (SIDE_LEFT + width, y), GRID)
        text(image, str(mm), (SIDE_LEFT - 8, y + 4), FAINT_TEXT, SMALL, align=1)


def _draw_rulers(image: Image, imaging: Imaging) -> None:
    """Write depths and lateral positions beside the frame."""
    scale, half_mm = _frame_scale(imaging), 1e3 * imaging.width / 2
    height, _ = _frame_size(imaging)
    for mm in range(0, round(1e3 * imaging.depth) + 1, 10):
        text(image, str(mm), (FRAME_LEFT - 8, TOP + mm * scale + 4), FAINT_TEXT, SMALL, align=1)
    for mm in (-int(half_mm), 0, int(half_mm)):
        x = FRAME_LEFT + (mm + half_mm) * scale
        text(image, _signed(mm), (x, TOP + height + 18), FAINT_TEXT, SMALL, align=0.5)


def _panel(image: Image, left: int, width: float, height: float, title: str, unit: str) -> None:
    """Fill a panel, darker with depth, and write its title above."""
    rows, columns = round(height), round(width)
    ramp = np.linspace(PANEL_TOP, PANEL_BOTTOM, rows)[:, np.newaxis, :]
    image[TOP : TOP + rows, left : left + columns] = ramp.astype(np.uint8)
    text(image, title, (left, 30), TEXT, 0.6, bold=True)
    text(image, unit, (left + width, 30), FAINT_TEXT, SMALL, align=1)


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
            lit_ball(image, center, ball.radius_mm * scale, BODY if index == 0 else LIMB)


def _draw_target(image: Image, phantom: Tissue, probe: Probe) -> None:
    """Draw the image plane of the target from above, a line, and from the side."""
    scale, target = _scale(phantom), phantom.target
    middle, half = (phantom.width_mm / 2 + target.x_mm) * scale, probe.width / 2 * scale
    along, across = half * cos_deg(target.angle_deg), half * sin_deg(target.angle_deg)
    x, y = ABOVE_LEFT + middle, TOP + phantom.height_mm / 2 * scale
    line(image, (x - along, y - across), (x + along, y + across), BODY, 4)
    x, width, bottom = SIDE_LEFT + middle, max(abs(along), 2.0), TOP + phantom.depth_mm * scale
    corners = [(x - width, TOP), (x + width, TOP), (x + width, bottom), (x - width, bottom)]
    polygon(image, corners, BODY, 0.35, outline=True)


def _draw_above(image: Image, phantom: Tissue, pose: Pose, probe: Probe) -> None:
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

    half, slab = probe.width / 2, probe.slab / 2
    polygon(
        image, [at(-half, -slab), at(half, -slab), at(half, slab), at(-half, slab)], BEAM, 0.3, outline=True
    )
    line(image, at(-half, 0), at(half, 0), BEAM, 2)
    dot(image, at(-half + 2.5, -slab + 2.2), 4, METAL)
    cross(image, center)


def _draw_side(image: Image, phantom: Tissue, pose: Pose, probe: Probe) -> None:
    """Draw the probe on the skin, its image plane as seen from the side, the beam and the focal point."""
    scale = _scale(phantom)
    center, bottom = SIDE_LEFT + (phantom.width_mm / 2 + pose.x_mm) * scale, TOP + phantom.depth_mm * scale
    focus = TOP + pose.focal_depth_mm * scale
    cosine, sine = cos_deg(pose.angle_deg), sin_deg(pose.angle_deg)
    half = abs(cosine) * probe.width / 2 * scale
    slab = half + abs(sine) * probe.slab / 2 * scale  # what is seen has a thickness, which shows from aside
    corners = [(center - slab, TOP), (center + slab, TOP), (center + slab, bottom), (center - slab, bottom)]
    polygon(image, corners, BEAM, 0.14, outline=True)
    aperture = probe.aperture / 2 * abs(cosine) * scale
    reach = min(1.0, (bottom - focus) / max(focus - TOP, 1.0))
    polygon(image, [(center - aperture, TOP), (center + aperture, TOP), (center, focus)], BEAM, 0.22)
    foot = focus + (focus - TOP) * reach
    spread = aperture * reach
    polygon(image, [(center, focus), (center + spread, foot), (center - spread, foot)], BEAM, 0.22)
    line(image, (center - slab, focus), (center + slab, focus), FOCUS)

    shell = slab + scale
    handle = 0.72 * shell
    outline = [(center - handle, TOP - 38), (center + handle, TOP - 38), (center + shell, TOP - 12)]
    outline += [(center + shell, TOP), (center - shell, TOP), (center - shell, TOP - 12)]
    polygon(image, outline, METAL, 1.0)
    line(image, (center - slab, TOP - 1), (center + slab, TOP - 1), BEAM, 3)
    marker = center - cosine * (probe.width / 2 - 2.5) * scale
    dot(image, (marker, TOP - 10), 4, BACKGROUND)
    cross(image, (center, focus))


def _draw_frame(image: Image, pose: Pose, frame: Image, imaging: Imaging) -> None:
    """Draw the frame enlarged, with the probe's orientation mark and the depth of the focus."""
    shape = imaging.height_px, imaging.width_px
    if frame.shape != shape or frame.dtype != np.uint8:
        raise ValueError(f"frame must be {shape} uint8, not {frame.shape} {frame.dtype}.")
    (height, width), scale = _frame_size(imaging), _frame_scale(imaging)
    enlarged = cv2.resize(frame, (width, height), interpolation=cv2.INTER_CUBIC)
    image[TOP : TOP + height, FRAME_LEFT : FRAME_LEFT + width] = enlarged[:, :, np.newaxis]
    dot(image, (FRAME_LEFT + 2.5 * scale, TOP - 10), 4, METAL)
    if pose.focal_depth_mm <= 1e3 * imaging.depth:
        right, focus = FRAME_LEFT + width + 5, TOP + pose.focal_depth_mm * scale
        polygon(image, [(right, focus), (right + 12, focus - 7), (right + 12, focus + 7)], FOCUS, 1.0)


def _signed(number: int) -> str:
    """Return the number with a sign, 0 without."""
    return f"{number:+d}".replace("-", "\u2212") if number else "0"
