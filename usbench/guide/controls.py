"""How a person takes the actions of a task: keys, icons, and advice in words."""

from dataclasses import dataclass

from usbench.coordinates import POSE
from usbench.envs.pose import Move
from usbench.envs.task import Task


@dataclass(frozen=True)
class Control:
    """One action on the page.

    Attributes:
        name: What the task calls the action.
        advice: The words that advise this action.
        key: The key that takes this action, as browsers name it.
        key_label: What is printed on that key.
        icon: Name of the arrow or sign, one of the page's symbols.
    """

    name: str
    advice: str
    key: str
    key_label: str
    icon: str


STAY = ("hold still", " ", "Space", "hold")
STOP = ("stop here", "s", "S", "stop")
# Coordinate and direction of the move -> advice, key, label of the key, icon.
MOVES = {
    ("x_mm", -1): ("move left", "ArrowLeft", "←", "left"),
    ("x_mm", 1): ("move right", "ArrowRight", "→", "right"),
    ("focal_depth_mm", -1): ("move the focus up", "ArrowUp", "↑", "up"),
    ("focal_depth_mm", 1): ("move the focus down", "ArrowDown", "↓", "down"),
    ("angle_deg", -1): ("rotate counter-clockwise", "e", "E", "counter-clockwise"),
    ("angle_deg", 1): ("rotate clockwise", "r", "R", "clockwise"),
}


def controls(task: Task) -> list[Control]:
    """Return how a person takes each action; a move along several coordinates goes by the first of them."""
    rows = [_row(action.move) for action in task.actions]
    if task.stops:
        rows[-1] = STOP
    return [Control(action.name, *row) for action, row in zip(task.actions, rows, strict=True)]


def _row(move: Move) -> tuple[str, str, str, str]:
    for name in POSE:
        change = getattr(move, name)
        if change:
            return MOVES[name, 1 if change > 0 else -1]
    return STAY
