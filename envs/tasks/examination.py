"""The examination: position, focal depth and rotation together, as a hand holds the probe."""

from __future__ import annotations

from dataclasses import replace

from usbench.envs.guidance import GuidanceEnv
from usbench.envs.pose import Move, Pose, sin_deg
from usbench.envs.task import Action, Task
from usbench.envs.tasks.focal_point import distance_mm
from usbench.envs.tasks.probe_plane import PROBE_PLANE


def reward(pose: Pose, target: Pose, kind: str) -> float:
    """Return the negative sum of the focal-point and the probe-plane task's distances (mm, or normalized)."""
    lateral, axial = abs(pose.x_mm - target.x_mm), abs(pose.focal_depth_mm - target.focal_depth_mm)
    sine = abs(sin_deg(pose.angle_deg - target.angle_deg))
    return -(lateral / 20 + axial / 50 + sine) if kind == "normalized" else -(lateral + axial + sine)


def is_success(pose: Pose, target: Pose) -> bool:
    """Return whether the focal point is at the object's centre and the object's plane is shown."""
    return distance_mm(pose, target) == 0 and sin_deg(pose.angle_deg - target.angle_deg) == 0


_STATES = tuple(
    Pose(x_mm, depth_mm, angle)
    for depth_mm in range(5, 91, 5)
    for x_mm in range(-20, 21, 5)
    for angle in range(0, 360, 15)
)

EXAMINATION = Task(
    name="exam",
    title="Examination",
    actions=(
        Action("stay", Move()),
        Action("left", Move(x_mm=-5)),
        Action("right", Move(x_mm=5)),
        Action("up", Move(focal_depth_mm=-5)),
        Action("down", Move(focal_depth_mm=5)),
        Action("rotate counter-clockwise", Move(angle_deg=-15)),
        Action("rotate clockwise", Move(angle_deg=15)),
    ),
    starts=_STATES,
    displacements=PROBE_PLANE.displacements,
    states=_STATES,
    reward=reward,
    is_success=is_success,
    distance_mm=distance_mm,
    # The farthest start is 4 + 9 + 6 moves away.
    n_steps=24,
)
EXAMINATION_STOP = replace(
    EXAMINATION,
    name="exam-stop",
    title="Examination with a stop",
    actions=(*EXAMINATION.actions, Action("stop", Move())),
    stops=True,
)


class ExaminationEnv(GuidanceEnv):
    """Find the position, the focal depth and the rotation that show the object best, all at once.

    ## Description
    A linear array stands anywhere on a tissue phantom with a bright object in it, focused at any depth and
    turned by any angle. The agent sees nothing but the B-mode frame, and should bring the focal point to the
    object's centre and the image plane into the object's. With probability `noise` the probe slips after an
    action: a fair coin decides between 5 mm along x and 15 degrees, to either side. The paper's two tasks,
    FP and PP of Jarosik and Lewandowski (IEEE IUS 2019), change two of the three coordinates each.

    ## Action Space
    `Discrete(7)`: 0 stay, 1 left (x - 5 mm), 2 right (x + 5 mm), 3 up (focus 5 mm shallower), 4 down (5 mm
    deeper), 5 rotate by -15 degrees (counter-clockwise, looking down on the probe), 6 rotate by +15 degrees.
    The probe's centre stays in [-20, 20] mm and its focus in [5, 90] mm: a move beyond is not made.

    ## Observation Space
    `Box(0, 255, (height_px, width_px, 1), uint8)`: the B-mode frame (depth, lateral, channel), its size and
    pixels those of `imaging`; by default (90, 40, 1) and 1 mm. The truth is in `info` only: `x_mm`,
    `focal_depth_mm`, `angle_deg`, `distance_mm` (L1 from the focal point to the object's centre),
    `sin_angle`, `noise` and `is_success` (no distance and in plane).

    ## Rewards
    For the pose after the action and before the noise: `"normalized"`: -(|x - x_o| / 20 + |z - z_o| / 50 +
    |sin(angle - angle_o)|); `"paper"`: the same with both distances in mm.
    `"image"`: how similar the frame is to the standard view of the object, from -1 to 1, less 1
    (`envs/image_reward.py`);
    `info` then also holds `true_reward`, the normalized one.

    ## Episode End
    Truncated after 24 steps, never terminated. Starts: x in {-20, -15, ..., 20} mm, focus in {5, 10, ..., 90}
    mm, every multiple of 15 degrees; `reset(options={"x_mm": ..., "focal_depth_mm": ..., "angle_deg": ...})`
    sets any of them.

    ## Arguments
    `noise` (probability, default 0), `reward` ("normalized", "paper" or "image"), `phantom` (`Phantom`
    or `Anatomy`), `probe` (`LinearArray`), `imaging` (`Imaging`), `render_mode` (None or "rgb_array"),
    `senses` (what is told beside the frame, such as `("position", "heading")`; `()` for nothing,
    None for the task's own).
    """

    task = EXAMINATION


class ExaminationStopEnv(GuidanceEnv):
    """Find the position, the rotation and the focal depth that show the object best, and stop there.

    ## Description
    As `ExaminationEnv`, and the agent says when it is done.

    ## Action Space
    `Discrete(8)`: those of `ExaminationEnv`, and 7 stop.

    ## Observation Space
    As in `ExaminationEnv`.

    ## Rewards
    As in `ExaminationEnv`; stopping earns the reward of the pose for each of the steps that are left, this
    one among them, as if the probe were held there. They are counted to 24, whatever `max_episode_steps` is.

    ## Episode End
    Terminated by stopping, truncated after 24 steps.

    ## Arguments
    As in `ExaminationEnv`.
    """

    task = EXAMINATION_STOP
