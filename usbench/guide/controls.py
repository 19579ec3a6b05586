"""How a person takes the actions of a task: keys, icons, and advice in words."""

from dataclasses import dataclass

from usbench.coordinates import COORDINATES, Key
from usbench.envs.pose import Move
from usbench.envs.task import Action, Task


@dataclass(frozen=True)
class Control:
    """One action on the page.

    Attributes:
        name: What the page calls the action: as the task does, "focus up" for "up".
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


STAY = Key("hold still", " ", "Space", "hold")
STOP = Key("stop here", "s", "S", "stop")


def controls(task: Task) -> list[Control]:
    """Return how a person takes each action; a move along several coordinates goes by the first of them."""
    rows = [_row(action.move) for action in task.actions]
    if task.stops:
        rows[-1] = STOP
    return [Control(name(action), *row) for action, row in zip(task.actions, rows, strict=True)]


def name(action: Action) -> str:
    """Return what the page calls an action; beside a probe, "up" alone does not say what goes up."""
    return f"focus {action.name}" if action.name in ("up", "down") else action.name


def _row(move: Move) -> Key:
    for one in COORDINATES:
        change = getattr(move, one.name)
        if change and one.keys:
            return one.keys[change > 0]
    return STAY
