"""The exact optimum of a task and the returns of random and idle hands, by dynamic programming over poses."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt
from gymnasium.envs.registration import load_env_creator

from usbench.anchors import Anchors
from usbench.checks import probability, unknown
from usbench.envs.guidance import GuidanceEnv
from usbench.envs.pose import Move, Pose
from usbench.envs.task import REWARDS, Task, check_reward

PAPER_TARGET = Pose(0, 50, 0)


@dataclass(frozen=True, eq=False)
class Policy:
    """The best policy that knows the pose: a table over steps and poses.

    Attributes:
        task: The task that it solves.
        actions: Best action in every pose with `step` steps done, (n_steps, n_states) int8, read-only.
        costs: By how much the expected return of an action falls short of the best one's, 0 for the best,
            (n_steps, n_states, n_actions), read-only.
        values: Expected return from there to the end, (n_steps + 1, n_states), read-only.
    """

    task: Task
    actions: npt.NDArray[np.int8]
    costs: npt.NDArray[np.float64]
    values: npt.NDArray[np.float64]

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the coordinates that `action` takes, in their order."""
        return self.task.coordinates

    @property
    def best(self) -> npt.NDArray[np.bool_]:
        """Whether an action is as good as the best one, (n_steps, n_states, n_actions)."""
        return np.asarray(self.costs == 0)

    def action(self, step: int, pose: Pose | tuple[int, ...]) -> int:
        """Return the best action after `step` steps at `pose` (its coordinates in the task's order)."""
        return int(self.actions[self._step(step), self._state(pose)])

    def value(self, step: int, pose: Pose | tuple[int, ...]) -> float:
        """Return the expected return of the steps that are left after `step` steps at `pose`."""
        return float(self.values[self._step(step), self._state(pose)])

    def _step(self, step: int) -> int:
        if not 0 <= step < self.task.n_steps:
            raise ValueError(f"step must be in [0, {self.task.n_steps - 1}], not {step!r}.")
        return int(step)

    def _state(self, pose: Pose | tuple[int, ...]) -> int:
        if not isinstance(pose, Pose):
            pose = self.task.pose(dict(zip(self.task.coordinates, pose, strict=True)))
        index = self.task.indices.get(pose)
        if index is None:
            raise ValueError(f"pose must be one that task {self.task.name!r} can reach, not {pose}.")
        return index


class Planner:
    """The best policies for every phantom that there may be; a plan is made when its phantom is met first."""

    def __init__(self, task: str | Task, noise: float = 0.0) -> None:
        """Nothing is planned yet; arguments and errors are those of `returns`."""
        self._task, self._noise = _task(task), probability("noise", noise)
        self._policies: dict[Pose, Policy] = {}

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the coordinates that `action` takes, in their order."""
        return self._task.coordinates

    def action(self, step: int, pose: tuple[int, ...], target: tuple[int, ...] | None = None) -> int:
        """Return the best action after `step` steps at `pose`; `target` is the paper's unless given."""
        goal = PAPER_TARGET if target is None else Pose(*target)
        if goal not in self._policies:
            self._policies[goal] = policy(self._task, self._noise, target=goal)
        return self._policies[goal].action(step, pose)


def returns(
    task: str | Task,
    noise: float = 0.0,
    reward: str = "normalized",
    target: Pose = PAPER_TARGET,
    starts: tuple[Pose, ...] | None = None,
) -> Anchors:
    """Return the expected returns of the optimal policy, of random actions and of staying.

    Args:
        task: Its short name, "fp" for example, or a `Task`.
        noise: Probability of a displacement after each action.
        reward: "normalized" or "paper".
        target: The pose that shows the object best; the default is that of the paper's phantom.
        starts: Where episodes begin; default: the task's starts, each as often as the others.

    Raises:
        TypeError: If `noise` is not a number.
        ValueError: If `task` or `reward` is unknown or `noise` outside [0, 1].
    """
    task = _task(task)
    return _returns(task, probability("noise", noise), _kind(task, reward), target, starts or task.starts)


def policy(
    task: str | Task, noise: float = 0.0, reward: str = "normalized", target: Pose = PAPER_TARGET
) -> Policy:
    """Return the optimal policy; arguments and errors are those of `returns`."""
    task = _task(task)
    return _policy(task, probability("noise", noise), _kind(task, reward), target)


def _kind(task: Task, reward: str) -> str:
    """Return the kind of reward, if `task` has it and poses tell it."""
    return check_reward(reward, task, REWARDS)


@lru_cache(maxsize=256)
def _returns(task: Task, noise: float, reward: str, target: Pose, poses: tuple[Pose, ...]) -> Anchors:
    starts = [task.indices[pose] for pose in poses]
    stay = [action.move for action in task.actions].index(Move())
    uniform = np.full(len(task.actions), 1 / len(task.actions))
    idle = np.eye(len(task.actions))[stay]
    optimal = _policy(task, noise, reward, target).values[0]
    random, staying = (_values(task, noise, reward, target, weights) for weights in (uniform, idle))
    return Anchors(*(float(values[starts].mean()) for values in (optimal, random, staying)))


@lru_cache(maxsize=256)
def _policy(task: Task, noise: float, reward: str, target: Pose) -> Policy:
    """Backward induction: Q_t(s, a) = r(s') + E[V_t+1(s' displaced)], with s' the pose after a in s."""
    costs = np.zeros((task.n_steps, len(task.states), len(task.actions)))
    values = np.zeros((task.n_steps + 1, len(task.states)))
    for step in reversed(range(task.n_steps)):
        q = _action_values(task, noise, reward, target, values[step + 1], task.n_steps - step)
        values[step] = q.max(axis=1)
        best = values[step][:, np.newaxis]
        # Rounding must not decide between equally good actions, or the bits differ between machines.
        costs[step] = np.where(q >= best - 1e-9, 0.0, best - q)
    actions = np.argmin(costs, axis=2).astype(np.int8)  # the first of the best
    for table in (actions, costs, values):
        table.flags.writeable = False
    return Policy(task, actions, costs, values)


def _values(
    task: Task, noise: float, reward: str, target: Pose, weights: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Return the expected return from every state, (n_states,), where action a has probability weights[a]."""
    values = np.zeros(len(task.states))
    for steps_left in range(1, task.n_steps + 1):
        values = _action_values(task, noise, reward, target, values, steps_left) @ weights
    return values


def _action_values(
    task: Task, noise: float, reward: str, target: Pose, values: npt.NDArray[np.float64], steps_left: int
) -> npt.NDArray[np.float64]:
    """Return reward plus expected value after the noise, (n_states, n_actions), from `values` one step on."""
    following, displaced = _transitions(task)
    rewards = _rewards(task, reward, target)
    expected = (1 - noise) * values + noise * values[displaced].mean(axis=1)
    q = np.asarray(rewards + expected, dtype=np.float64)[following]
    if task.stops:
        q[:, -1] = rewards * steps_left
    return q


@lru_cache(maxsize=16)
def _rewards(task: Task, reward: str, target: Pose) -> npt.NDArray[np.float64]:
    """Return the reward of being in every state, (n_states,)."""
    return np.array([task.reward(pose, target, reward) for pose in task.states], dtype=np.float64)


@lru_cache(maxsize=16)
def _transitions(task: Task) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Return the states after actions (n_states, n_actions), displacements (n_states, n_displacements)."""

    def after(moves: list[Move]) -> npt.NDArray[np.intp]:
        return np.array(
            [[task.indices[pose.moved(move, task.limits)] for move in moves] for pose in task.states]
        )

    return after([action.move for action in task.actions]), after(list(task.displacements))


def _task(task: str | Task) -> Task:
    if isinstance(task, Task):
        return task
    known = _tasks()
    if not isinstance(task, str) or task not in known:
        raise unknown("task", task, tuple(known))
    return known[task]


def _tasks() -> dict[str, Task]:
    """Return the tasks of the environments that are registered here, by name."""
    specs = [spec for spec in gym.registry.values() if spec.namespace == "usbench"]
    classes: list[Any] = [
        load_env_creator(spec.entry_point) for spec in specs if isinstance(spec.entry_point, str)
    ]
    return {
        cls.task.name: cls.task for cls in classes if isinstance(cls, type) and issubclass(cls, GuidanceEnv)
    }
