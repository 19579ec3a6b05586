"""The coordinates of a pose and the scanner's settings, one row each: what all of usbench says of them.

Poses, moves and limits, slips in words, labels of axes, the columns of records, the guide's keys and what an
agent is told of a tracked probe follow from these rows.
This module imports nothing of the project, so that all of it can read the table.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple


class Key(NamedTuple):
    """How a person changes a coordinate on the guide's page.

    Attributes:
        advice: The words that advise this change.
        key: The key that makes this change, as browsers name it.
        key_label: What is printed on that key.
        icon: Name of the arrow, one of the page's symbols.
    """

    advice: str
    key: str
    key_label: str
    icon: str


@dataclass(frozen=True, kw_only=True)
class Coordinate:
    """A coordinate of the probe, or a setting of the scanner; its values are whole numbers.

    Attributes:
        name: Of the attribute of poses, moves and limits, and in `info` and records; it ends with the unit.
        label: What an axis that shows it is called.
        value: A value in words, for `str.format`.
        less: Which way a negative change goes, in words.
        more: Which way a positive change goes.
        change: The size of a change in words, for `str.format`.
        change_scale: Number of units in which `change` is told, per unit of the coordinate.
        limits: Lowest and highest value unless a task says others; None where values come round again.
        least: Smallest value that a pose can have; None for any.
        period: After how much values come round again; None where they do not.
        is_setting: Whether it is one of the scanner, which plain poses do not have.
        keys: Of a negative and of a positive change on the guide's page; None where the page has none.
        sense: What an agent that is told the value calls it; None where no agent is told.
    """

    name: str
    label: str
    value: str
    less: str
    more: str
    change: str
    change_scale: float = 1.0
    limits: tuple[int, int] | None = None
    least: int | None = None
    period: int | None = None
    is_setting: bool = False
    keys: tuple[Key, Key] | None = None
    sense: str | None = None

    def change_in_words(self, change: int) -> str:
        """Return a change as a person says it, "5 mm to the left" for example."""
        size = self.change.format(abs(change) * self.change_scale)
        return f"{size} {self.more if change > 0 else self.less}"


COORDINATES = (
    Coordinate(
        name="x_mm", label="position of the probe (mm)", value="x {} mm",
        less="to the left", more="to the right", change="{:g} mm", limits=(-20, 20),
        sense="position",
        keys=(Key("move left", "ArrowLeft", "←", "left"), Key("move right", "ArrowRight", "→", "right")),
    ),
    Coordinate(
        name="focal_depth_mm", label="focal depth (mm)", value="{} mm deep",
        less="shallower", more="deeper", change="{:g} mm", limits=(5, 90), least=1,
        sense="focus",
        keys=(
            Key("move the focus up", "ArrowUp", "↑", "up"),
            Key("move the focus down", "ArrowDown", "↓", "down"),
        ),
    ),
    Coordinate(
        name="angle_deg", label="angle (degrees)", value="{} degrees",
        less="counter-clockwise", more="clockwise", change="{:g}°", period=360,
        sense="heading",
        keys=(
            Key("rotate counter-clockwise", "e", "E", "counter-clockwise"),
            Key("rotate clockwise", "r", "R", "clockwise"),
        ),
    ),
    Coordinate(
        name="frequency_khz", label="frequency (kHz)", value="{} kHz",
        less="down", more="up", change="{:g} MHz", change_scale=1e-3, limits=(2_000, 5_000), least=1,
        is_setting=True,
    ),
    Coordinate(
        name="dynamic_range_db", label="dynamic range (dB)", value="{} dB",
        less="narrower", more="wider", change="{:g} dB", limits=(20, 90), least=1, is_setting=True,
    ),
)  # fmt: skip
BY_NAME = {one.name: one for one in COORDINATES}
# Names of what every pose has, of what a pose with settings has besides, and of the pose to be found.
POSE = tuple(one.name for one in COORDINATES if not one.is_setting)
SETTINGS = tuple(one.name for one in COORDINATES if one.is_setting)
TARGET = tuple(f"target_{name}" for name in POSE)
