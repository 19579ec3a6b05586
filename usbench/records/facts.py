"""What is recorded of one episode; it needs no agent, so that it loads no torch."""

from typing import Any

from usbench.coordinates import BY_NAME, TARGET
from usbench.records.episode import MEASURES


class Facts:
    """What is recorded of one episode, from its first info on."""

    def __init__(self, info: dict[str, Any]) -> None:
        """Begin with the info of the reset."""
        self._pose_keys = [key for key in BY_NAME if key in info]
        self._poses = {f"start_{key}": int(info[key]) for key in self._pose_keys}
        self._poses |= {key: int(info[key]) for key in TARGET if key in info}
        self._phantom = int(info["phantom"]) if "phantom" in info else None
        self._return = 0.0
        self._to_goal: int | None = None
        self.actions: list[int] = []

    @property
    def options(self) -> dict[str, int]:
        """The options of a reset that begins the same episode."""
        phantom = {} if self._phantom is None else {"phantom": self._phantom}
        return {key: self._poses[f"start_{key}"] for key in self._pose_keys} | phantom

    def add(self, action: Any, reward: float, info: dict[str, Any]) -> None:
        """Add one step."""
        self.actions.append(int(action))
        # Trained on whatever reward, an agent is judged by the true one.
        self._return += float(info.get("true_reward", reward))
        if info["is_success"] and self._to_goal is None:
            self._to_goal = len(self.actions)

    @property
    def monitored(self) -> dict[str, Any]:
        """What SB3's `Monitor` would write, so that SB3 logs its mean return as usual."""
        return {"r": self._return, "l": len(self.actions)}

    def report(self, info: dict[str, Any]) -> dict[str, Any]:
        """Return the fields of `records.Episode` but its counters, and `actions`; `info` is the last."""
        return {
            "return_": self._return,
            "poses": self._poses | {f"final_{key}": int(info[key]) for key in self._pose_keys},
            "phantom": self._phantom,
            "measures": {f"final_{name}": float(info[name]) for name in MEASURES if name in info},
            "final_distance_mm": float(info["distance_mm"]),
            "final_sin_angle": float(info["sin_angle"]),
            "is_success": bool(info["is_success"]),
            "steps_to_goal": self._to_goal,
            "actions": tuple(self.actions),
        }
