"""An episode as a line of a record file."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

from usbench.coordinates import POSE, SETTINGS, TARGET


def _columns(names: Sequence[str]) -> tuple[str, ...]:
    return tuple(f"{when}_{name}" for when in ("start", "final") for name in names)


# What environments may measure of a frame, by the names in their `info`.
MEASURES = ("contrast_to_noise", "gcnr", "contrast_order")
# Keys of a line in their order; those of `Evaluation` follow. What an episode does not have is left out.
COLUMNS = (
    *("episode", "step", "return", *_columns(POSE), "final_distance_mm", "final_sin_angle", "is_success"),
    *("steps_to_goal", "phantom", *TARGET, *_columns(SETTINGS)),
    *(f"final_{name}" for name in MEASURES),
)


@dataclass(frozen=True, kw_only=True)
class Episode:
    """One episode, from its start to the pose after its last step.

    Attributes:
        episode: Number of the episode, from 0.
        step: Training steps made at its end (for an evaluation: when it took place).
        return_: Sum of rewards; the key in files is `return`.
        poses: Coordinates of the start (`start_x_mm`, ..) and of the final pose (`final_x_mm`, ..), with the
            scanner's settings where the task changes them; and of the pose that shows the object best
            (`target_x_mm`, ..) where that is not the paper's. In files each has a separate key.
        final_distance_mm: Distance from the object as the task defines it.
        final_sin_angle: Sine of the angle between image plane and object.
        is_success: Whether the final pose is the goal.
        steps_to_goal: Steps until the goal was first reached, None if it never was.
        phantom: Number of the episode's phantom, where each has its own; only then in files.
        measures: What the environment measures of the final frame (`final_gcnr`, ..), where it measures
            anything. In files each has a separate key.
    """

    episode: int
    step: int
    return_: float
    poses: Mapping[str, int]
    final_distance_mm: float
    final_sin_angle: float
    is_success: bool
    steps_to_goal: int | None
    phantom: int | None = None
    measures: Mapping[str, float] = field(default_factory=dict)

    def as_row(self) -> dict[str, Any]:
        """Return the line of the record file, as a dictionary."""
        values = {one.name.rstrip("_"): getattr(self, one.name) for one in fields(self)}
        if self.phantom is None:
            del values["phantom"]
        values |= values.pop("poses") | values.pop("measures")
        later = [name for name in values if name not in COLUMNS]
        return {name: values[name] for name in (*COLUMNS, *later) if name in values}


@dataclass(frozen=True, kw_only=True)
class Evaluation(Episode):
    """One evaluation episode at one evaluation point.

    Attributes:
        checkpoint: The evaluation point: a planned training step, the same for every algorithm; `step` is the
            real one.
        deterministic: Whether the actions were greedy rather than sampled.
        eval_episode: Number in the fixed list of evaluation episodes.
        actions: The actions taken, which together with the list are enough to replay the episode.
    """

    checkpoint: int
    deterministic: bool
    eval_episode: int
    actions: Sequence[int]
