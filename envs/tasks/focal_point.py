"""The focal-point task: bring the probe over the object and the focus to its depth."""

from __future__ import annotations

from usbench.envs.guidance import GuidanceEnv
from usbench.envs.pose import Move, Pose
from usbench.envs.task import Action, Task


def reward(pose: Pose, target: Pose, kind: str) -> float:
    """Return the negative L1 distance of the focal point to the object, Eq. 1 (in mm) or normalized."""
    lateral, axial = abs(pose.x_mm - target.x_mm), abs(pose.focal_depth_mm - target.focal_depth_mm)
    return -(lateral / 20 + axial / 50) if kind == "normalized" else -float(lateral + axial)


def distance_mm(pose: Pose, target: Pose) -> float:
    """Return the L1 distance of the focal point to the object's centre."""
    return float(abs(pose.x_mm - target.x_mm) + abs(pose.focal_depth_mm - target.focal_depth_mm))


def is_success(pose: Pose, target: Pose) -> bool:
    """Return whether the focal point is at the object's centre."""
    return pose.x_mm == target.x_mm and pose.focal_depth_mm == target.focal_depth_mm


FOCAL_POINT = Task(
    name="fp",
    title="Focal point",
    actions=(
        Action("stay", Move()),
        Action("left", Move(x_mm=-5)),
        Action("right", Move(x_mm=5)),
        Action("up", Move(focal_depth_mm=-5)),
        Action("down", Move(focal_depth_mm=5)),
    ),
    starts=tuple(Pose(x_mm, 10, 0) for x_mm in range(-20, 21, 5)),
    displacements=tuple(Move(x_mm=5 * c) for c in (-2, -1, 1, 2)),
    states=tuple(Pose(x_mm, z_mm, 0) for x_mm in range(-20, 21, 5) for z_mm in range(5, 91, 5)),
    reward=reward,
    is_success=is_success,
    distance_mm=distance_mm,
)


class FocalPointEnv(GuidanceEnv):
    """Find the position of the probe and the depth of its focus that show the object best.

    ## Description
    A linear array stands on a tissue phantom with a bright object in it, and focuses at 10 mm: too shallow.
    The agent sees nothing but the B-mode frame, moves the probe along x and its focus in depth, and should
    bring the focal point to the object's centre and hold it there. With probability `noise` the probe slips
    by 5 or 10 mm to either side after an action. This is the FP task of Jarosik and Lewandowski (IEEE IUS
    2019).

    ## Action Space
    `Discrete(5)`: 0 stay, 1 left (x - 5 mm), 2 right (x + 5 mm), 3 up (focus 5 mm shallower), 4 down (5 mm
    deeper). The probe's centre stays in [-20, 20] mm and its focus in [5, 90] mm: a move beyond is not made.

    ## Observation Space
    `Box(0, 255, (height_px, width_px, 1), uint8)`: the B-mode frame (depth, lateral, channel), its size and
    pixels those of `imaging`; by default (90, 40, 1) and 1 mm. The truth is in `info` only: `x_mm`,
    `focal_depth_mm`, `angle_deg`, `distance_mm` (L1 from the focal point to the object's centre), `sin_angle`
    (signed, of the angle between image plane and object), `noise` (what was displaced and by how much, 0 if
    blocked at the border; empty without noise) and `is_success` (focal point at the centre).

    ## Rewards
    For the pose after the action and before the noise, with x_o and z_o the object's: `"normalized"`: -(|x -
    x_o| / 20 + |z - z_o| / 50); `"paper"`, Eq. 1: -(|x - x_o| + |z - z_o|), in mm.
    `"image"`: how similar the frame is to the standard view of the object, from -1 to 1, less 1
    (`envs/image_reward.py`);
    `info` then also holds `true_reward`, the normalized one.

    ## Episode End
    Truncated after 16 steps, never terminated. Starts: x in {-20, -15, ..., 20} mm, focus at 10 mm, angle 0;
    `reset(options={"x_mm": ..., "focal_depth_mm": ..., "angle_deg": ...})` sets any of them.

    ## Arguments
    `noise` (probability, default 0), `reward` ("normalized", "paper" or "image"), `phantom` (`Phantom`
    or `Anatomy`), `probe` (`LinearArray`), `imaging` (`Imaging`), `render_mode` (None or "rgb_array"),
    `senses` (what is told beside the frame, such as `("position", "focus")`; `()` for nothing,
    None for the task's own).
    """

    task = FOCAL_POINT
