"""A moment of an episode and an agent's advice in it, as plain data."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from usbench.envs.pose import Pose

MEANINGS = {
    "probability": "probability of the action",
    "value": "discounted return that the agent expects",
    "return": "expected return to the end of the episode",
    "loss": "expected return minus that of the best action",
    "choice": "the agent's choice",
}


@dataclass(frozen=True)
class Advice:
    """What an agent thinks of every action.

    Attributes:
        weights: One number per action: its probability, the discounted return that the agent expects, the
            exact return to the end of the episode, what the agent expects to lose against the best action,
            below 0, or 1 for the action of an agent that tells no more, and 0 for the others.
        kind: Which of MEANINGS the numbers are.
    """

    weights: tuple[float, ...]
    kind: Literal["probability", "value", "return", "loss", "choice"] = "probability"

    @property
    def best(self) -> int:
        """The action that the agent advises."""
        return int(np.argmax(self.weights))

    @property
    def meaning(self) -> str:
        """What the numbers are, in words."""
        return MEANINGS[self.kind]

    @property
    def bars(self) -> list[float]:
        """How long the bar of each action is, 0 to 1: probabilities as they are, the others stretched."""
        low, high = (0.0, 1.0) if self.kind == "probability" else (min(self.weights), max(self.weights))
        return [(weight - low) / ((high - low) or 1.0) for weight in self.weights]


# (observation, info, step) -> advice after `step` steps: how an agent is asked, `Adviser.advise` for example.
Ask = Callable[[Any, dict[str, Any], int], Advice]


@dataclass(frozen=True)
class Moment:
    """What there is to see after one step, or at the start.

    Attributes:
        step: Number of steps made, 0 at the start.
        picture: Scene beside frame, (height, width, 3) uint8.
        action: Name of the last action, "start" at the start.
        reward: Reward of that action.
        return_: Sum of the rewards so far.
        optimum: The sum of the best policy that knows the pose, from the same start, with the same slips.
        pose: Pose of the probe.
        distance_mm: Distance to the goal, as the task defines it.
        slip: What noise did to the probe after the action, in words; empty if nothing.
        is_success: Whether this pose is the goal.
        advice: What the agent advises now; None if it is not asked, and after the last step.
    """

    step: int
    picture: npt.NDArray[np.uint8]
    action: str
    reward: float
    return_: float
    optimum: float
    pose: Pose
    distance_mm: float
    slip: str
    is_success: bool
    advice: Advice | None
