"""An episode as a line of a record file."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from usbench.coordinates import SETTINGS, TARGET

# In `info` and in files where every episode has a phantom of its own.
OF_A_PHANTOM = ("phantom", *TARGET)


@dataclass(frozen=True, kw_only=True)
class Episode:
    """One episode, from its start to the pose after its last step.

    Attributes:
        episode: Number of the episode, from 0.
        step: Training steps made at its end (for an evaluation: when it took place).
        return_: Sum of rewards; the key in files is `return`.
        start_x_mm: Start pose, like the two after it.
        final_x_mm: Final pose, like the two after it.
        final_distance_mm: Distance from the object as the task defines it.
        final_sin_angle: Sine of the angle between image plane and object.
        is_success: Whether the final pose is the goal.
        steps_to_goal: Steps until the goal was first reached, None if it never was.
        phantom: Number of the episode's phantom, where each has its own; only then in files.
        target_x_mm: Pose that shows its object best, like the two after it; in files where it is not the
            paper's.
        start_frequency_khz: Settings of the scanner at the start and at the end, like the three after it,
            where the task changes them; only then in files.
    """

    episode: int
    step: int
    return_: float
    start_x_mm: int
    start_focal_depth_mm: int
    start_angle_deg: int
    final_x_mm: int
    final_focal_depth_mm: int
    final_angle_deg: int
    final_distance_mm: float
    final_sin_angle: float
    is_success: bool
    steps_to_goal: int | None
    phantom: int | None = None
    target_x_mm: int | None = None
    target_focal_depth_mm: int | None = None
    target_angle_deg: int | None = None
    start_frequency_khz: int | None = None
    start_dynamic_range_db: int | None = None
    final_frequency_khz: int | None = None
    final_dynamic_range_db: int | None = None

    def as_row(self) -> dict[str, Any]:
        """Return the line of the record file, as a dictionary."""
        row = {key.rstrip("_"): value for key, value in asdict(self).items()}
        return {key: value for key, value in row.items() if key not in _MAY_LACK or value is not None}


_MAY_LACK = (*OF_A_PHANTOM, *(f"{when}_{name}" for when in ("start", "final") for name in SETTINGS))


@dataclass(frozen=True, kw_only=True)
class Evaluation(Episode):
    """One evaluation episode at one checkpoint.

    Attributes:
        checkpoint: Planned training step, the same for every algorithm; `step` is the real one.
        deterministic: Whether the agent took its most likely action rather than a drawn one.
        eval_episode: Number in the suite's fixed list.
        actions: The actions taken, which together with the list are enough to replay the episode.
    """

    checkpoint: int
    deterministic: bool
    eval_episode: int
    actions: Sequence[int]
