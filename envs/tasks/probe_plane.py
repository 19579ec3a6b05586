"""The probe-plane task: bring the probe over the object and turn the image plane into the object's."""

from __future__ import annotations

from usbench.envs.guidance import GuidanceEnv
from usbench.envs.pose import Move, Pose, sin_deg
from usbench.envs.task import Action, Task


def reward(pose: Pose, target: Pose, kind: str) -> float:
    """Return the negative distance to the object plus sine of the plane's angle, Eq. 2 (mm) or normalized."""
    lateral = abs(pose.x_mm - target.x_mm)
    sine = abs(sin_deg(pose.angle_deg - target.angle_deg))
    return -(lateral / 20 + sine) if kind == "normalized" else -(lateral + sine)


def distance_mm(pose: Pose, target: Pose) -> float:
    """Return the lateral distance of the probe to the object's centre."""
    return float(abs(pose.x_mm - target.x_mm))


def is_success(pose: Pose, target: Pose) -> bool:
    """Return whether the probe is over the object and in its plane, from either side."""
    return pose.x_mm == target.x_mm and sin_deg(pose.angle_deg - target.angle_deg) == 0


PROBE_PLANE = Task(
    name="pp",
    title="Probe plane",
    actions=(
        Action("stay", Move()),
        Action("left", Move(x_mm=-5)),
        Action("right", Move(x_mm=5)),
        Action("rotate counter-clockwise", Move(angle_deg=-15)),
        Action("rotate clockwise", Move(angle_deg=15)),
    ),
    starts=tuple(Pose(x_mm, 50, angle) for x_mm in range(-15, 16, 5) for angle in (45, 60, 75, 90)),
    displacements=(Move(x_mm=-5), Move(x_mm=5), Move(angle_deg=-15), Move(angle_deg=15)),
    states=tuple(Pose(x_mm, 50, angle) for x_mm in range(-20, 21, 5) for angle in range(0, 360, 15)),
    reward=reward,
    is_success=is_success,
    distance_mm=distance_mm,
)


class ProbePlaneEnv(GuidanceEnv):
    """Find the position of the probe and the rotation of its image plane that show the object best.

    ## Description
    A linear array stands on a tissue phantom with a bright object in it, turned by 45 to 90 degrees away from
    the object's plane. The agent sees nothing but the B-mode frame, moves the probe along x and turns it
    about its own centre, and should bring it over the object and into its plane and hold it there. With
    probability `noise` the probe slips after an action: a fair coin decides between 5 mm and 15 degrees, to
    either side. This is the PP task of Jarosik and Lewandowski (IEEE IUS 2019).

    ## Action Space
    `Discrete(5)`: 0 stay, 1 left (x - 5 mm), 2 right (x + 5 mm), 3 rotate by -15 degrees (counter-clockwise,
    looking down on the probe), 4 rotate by +15 degrees (clockwise). The probe's centre stays in [-20, 20] mm:
    a move beyond is not made. Angles have no limit and count modulo 360.

    ## Observation Space
    `Box(0, 255, (height_px, width_px, 1), uint8)`: the B-mode frame (depth, lateral, channel), its size and
    pixels those of `imaging`; by default (90, 40, 1) and 1 mm. The truth is in `info` only: `x_mm`,
    `focal_depth_mm`, `angle_deg`, `distance_mm` (lateral, from the probe to the object's centre), `sin_angle`
    (signed, of the angle between image plane and object), `noise` (what was displaced and by how much, 0 if
    blocked at the border; empty without noise) and `is_success` (over the centre and in plane).

    ## Rewards
    For the pose after the action and before the noise, with x_o and angle_o the object's: `"normalized"`:
    -(|x - x_o| / 20 + |sin(angle - angle_o)|); `"paper"`, Eq. 2: -(|x - x_o| + |sin(angle - angle_o)|), x in
    mm.
    `"image"`: how similar the frame is to the standard view of the object, from -1 to 1, less 1
    (`envs/image_reward.py`);
    `info` then also holds `true_reward`, the normalized one.

    ## Episode End
    Truncated after 16 steps, never terminated. Starts: x in {-15, -10, ..., 15} mm, angle in {45, 60, 75, 90}
    degrees, focus at 50 mm; `reset(options={"x_mm": ..., "focal_depth_mm": ..., "angle_deg": ...})` sets any
    of them.

    ## Arguments
    `noise` (probability, default 0), `reward` ("normalized", "paper" or "image"), `phantom` (`Phantom`
    or `Anatomy`), `probe` (`LinearArray`), `imaging` (`Imaging`), `render_mode` (None or "rgb_array"),
    `senses` (what is told beside the frame, such as `("position", "heading")`; `()` for nothing,
    None for the task's own).
    """

    task = PROBE_PLANE
