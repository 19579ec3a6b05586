"""The exact optimum of a task and the returns of a random and an idle agent, by dynamic programming."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt
from gymnasium.envs.registration import load_env_creator

from usbench.anchors import Anchors
from usbench.checks import number, probability, unknown, whole_number
from usbench.envs.guidance import GuidanceEnv
from usbench.envs.pose import Move, Pose
from usbench.envs.task import REWARDS, Task, check_reward

# The states after actions (n_states, n_actions), and those after displacements (n_states, n_displacements).
_Transitions = tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]

PAPER_TARGET = Pose(0, 50, 0)


@dataclass(frozen=True)
class DecisionProcess:
    """A task as a Markov decision process: all that its optimum follows from.

    Attributes:
        task: States, actions and displacements.
        noise: Probability of a displacement after each action.
        reward: "normalized" or "paper".
        target: The pose that shows the object best; the default is that of the paper's phantom.
        rewards: Of being in every state of the task, (n_states,), in place of those that follow from `reward`
            and `target`: an environment whose rewards come from frames knows them, see
            `GuidanceEnv.state_rewards`.
    """

    task: Task
    noise: float = 0.0
    reward: str = "normalized"
    target: Pose = PAPER_TARGET
    rewards: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        """Hold the values as plain ones, or refuse them."""
        object.__setattr__(self, "noise", probability("noise", self.noise))
        if not isinstance(self.target, Pose):
            raise TypeError(f"target must be a Pose, not {self.target!r}.")
        if self.rewards is None:
            check_reward(self.reward, self.task, REWARDS)
            return
        rewards = tuple(number("a reward", reward) for reward in self.rewards)
        if len(rewards) != len(self.task.states):
            raise ValueError(
                f"the task {self.task.name!r} needs {len(self.task.states)} rewards, one of each of its "
                f"states, not {len(rewards)}."
            )
        object.__setattr__(self, "rewards", rewards)

    def returns(self, starts: tuple[Pose, ...] | None = None) -> Anchors:
        """Return the expected returns of the optimum, of random actions and of staying.

        `starts` are where episodes begin, each as often as the others; default: the task's.

        Raises:
            ValueError: If `starts` is empty, or one of them is no pose that the task reaches.
        """
        if starts is not None and not starts:
            raise ValueError("starts must be one pose at least, where episodes begin, not none.")
        return _returns(self, tuple(self.task.starts if starts is None else starts))

    def policy(self) -> Policy:
        """Return the optimal policy."""
        return _policy(self)

    @cached_property
    def state_rewards(self) -> npt.NDArray[np.float64]:
        """The reward of being in every state, (n_states,), read-only."""
        if self.rewards is not None:
            return _read_only(np.array(self.rewards))
        if self.task.reward_from_frames:
            return _rewards_from_frames(self.task)
        found = _rewards_from_poses(self.task, self.reward, self.target)
        if not np.isfinite(found).all():
            raise ValueError(
                f"the rewards of the task {self.task.name!r} must be finite, which some are not."
            )
        return found


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

    def returns(self, step: int, pose: Pose | tuple[int, ...]) -> npt.NDArray[np.float64]:
        """Return the expected return to the end of every action after `step` steps at `pose`, (n_actions,).

        The best policy follows the action; equally good actions have equal bits.
        """
        step, state = _place(self.task, step, pose)
        return np.asarray(self.values[step, state] - self.costs[step, state])

    def action(self, step: int, pose: Pose | tuple[int, ...]) -> int:
        """Return the best action after `step` steps at `pose` (its coordinates in the task's order)."""
        return int(self.actions[_place(self.task, step, pose)])

    def value(self, step: int, pose: Pose | tuple[int, ...]) -> float:
        """Return the expected return of the steps that are left after `step` steps at `pose`."""
        return float(self.values[_place(self.task, step, pose)])


class Planner:
    """The best actions for every phantom that there may be; a plan is made when its phantom is met first.

    A byte is kept per step and state, where a `Policy` of an examination has 65: examinations of drawn
    phantoms have 840 targets. Targets with equal rewards share a plan, as those of objects turned by 180
    degrees do.
    """

    def __init__(self, process: DecisionProcess) -> None:
        """Nothing is planned yet; other targets take the place of the process's own."""
        self._process = process
        self._actions: dict[Pose, npt.NDArray[np.int8]] = {}
        self._by_rewards: dict[bytes, npt.NDArray[np.int8]] = {}

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the coordinates that `action` takes, in their order."""
        return self._process.task.coordinates

    def action(self, step: int, pose: tuple[int, ...], target: tuple[int, ...] | None = None) -> int:
        """Return the best action after `step` steps at `pose`; `target` is the process's unless given."""
        goal = self._goal(target)
        if goal not in self._actions:
            self._actions[goal] = self._planned(goal)
        return int(self._actions[goal][_place(self._process.task, step, pose)])

    def policy(self, target: tuple[int, ...] | None = None) -> Policy:
        """Return the best policy for `target`, by default the process's own."""
        return replace(self._process, target=self._goal(target)).policy()

    def _goal(self, target: tuple[int, ...] | None) -> Pose:
        return self._process.target if target is None else Pose(*target)

    def _planned(self, goal: Pose) -> npt.NDArray[np.int8]:
        process = replace(self._process, target=goal)
        digest = hashlib.sha256(process.state_rewards.tobytes()).digest()
        if digest not in self._by_rewards:
            self._by_rewards[digest] = process.policy().actions
        return self._by_rewards[digest]


def returns(
    task: str | Task,
    noise: float = 0.0,
    reward: str = "normalized",
    target: Pose = PAPER_TARGET,
    *,
    rewards: Sequence[float] | None = None,
    starts: tuple[Pose, ...] | None = None,
) -> Anchors:
    """Return the expected returns of the optimal policy, of random actions and of staying.

    Args:
        task: Its short name, "fp" for example, or a `Task`.
        noise: Probability of a displacement after each action.
        reward: "normalized" or "paper".
        target: The pose that shows the object best; the default is that of the paper's phantom.
        rewards: Of every state of the task, (n_states,), in place of `reward` and `target`: those of
            `GuidanceEnv.state_rewards`, where frames tell them.
        starts: Where episodes begin; default: the task's starts, each as often as the others.

    Raises:
        TypeError: If `noise` is not a number.
        ValueError: If `task` or `reward` is unknown, `noise` outside [0, 1], the number of rewards wrong, or
            a start is no pose that the task can reach.
    """
    return DecisionProcess(_task(task), noise, reward, target, _plain(rewards)).returns(starts)


def policy(
    task: str | Task,
    noise: float = 0.0,
    reward: str = "normalized",
    target: Pose = PAPER_TARGET,
    *,
    rewards: Sequence[float] | None = None,
) -> Policy:
    """Return the optimal policy; arguments and errors are those of `returns`."""
    return DecisionProcess(_task(task), noise, reward, target, _plain(rewards)).policy()


def _plain(rewards: Sequence[float] | None) -> tuple[float, ...] | None:
    return None if rewards is None else tuple(rewards)


@lru_cache(maxsize=256)
def _returns(process: DecisionProcess, poses: tuple[Pose, ...]) -> Anchors:
    task = process.task
    starts = [task.index(pose) for pose in poses]
    uniform = np.full(len(task.actions), 1 / len(task.actions))
    idle = np.eye(len(task.actions))[task.stay]
    optimal = _policy(process).values[0]
    random, staying = (_values(process, weights) for weights in (uniform, idle))
    return Anchors(*(float(values[starts].mean()) for values in (optimal, random, staying)))


# Of a drawn examination a policy has 6 MB.
@lru_cache(maxsize=16)
def _policy(process: DecisionProcess) -> Policy:
    """Backward induction: Q_t(s, a) = r(s') + E[V_t+1(s' displaced)], with s' the pose after a in s."""
    task = process.task
    costs = np.zeros((task.n_steps, len(task.states), len(task.actions)))
    values = np.zeros((task.n_steps + 1, len(task.states)))
    moves = _transitions(task)
    for step in reversed(range(task.n_steps)):
        q = _action_values(process, moves, values[step + 1], task.n_steps - step)
        values[step] = q.max(axis=1)
        best = values[step][:, np.newaxis]
        # Rounding must not decide between equally good actions, or the bits differ between machines.
        costs[step] = np.where(q >= best - 1e-9, 0.0, best - q)
    actions = np.argmin(costs, axis=2).astype(np.int8)  # the first of the best
    for table in (actions, costs, values):
        table.flags.writeable = False
    return Policy(task, actions, costs, values)


def _place(task: Task, step: int, pose: Pose | tuple[int, ...]) -> tuple[int, int]:
    """Return where `step` and `pose` (its coordinates in the task's order) stand in tables of the task."""
    if not isinstance(pose, Pose):
        if len(pose) != len(task.coordinates):
            raise ValueError(f"pose must be a Pose or ({', '.join(task.coordinates)}), not {pose!r}.")
        pose = task.pose(dict(zip(task.coordinates, pose, strict=True)))
    return whole_number("step", step, 0, task.n_steps - 1), task.index(pose)


def _values(process: DecisionProcess, weights: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return the expected return from every state, (n_states,), where action a has probability weights[a]."""
    values, moves = np.zeros(len(process.task.states)), _transitions(process.task)
    for steps_left in range(1, process.task.n_steps + 1):
        values = _action_values(process, moves, values, steps_left) @ weights
    return values


def _action_values(
    process: DecisionProcess, moves: _Transitions, values: npt.NDArray[np.float64], steps_left: int
) -> npt.NDArray[np.float64]:
    """Return reward plus expected value after the noise, (n_states, n_actions), from `values` one step on."""
    following, displaced = moves
    rewards, noise = process.state_rewards, process.noise
    expected = (1 - noise) * values + noise * values[displaced].mean(axis=1)
    q = np.asarray(rewards + expected, dtype=np.float64)[following]
    if process.task.stops:
        q[:, -1] = rewards * steps_left
    return q


@lru_cache(maxsize=16)
def _rewards_from_poses(task: Task, reward: str, target: Pose) -> npt.NDArray[np.float64]:
    return _read_only(np.array([task.reward(pose, target, reward) for pose in task.states], dtype=np.float64))


@lru_cache(maxsize=16)
def _rewards_from_frames(task: Task) -> npt.NDArray[np.float64]:
    """Return the rewards in the task's own environment, as it is made by default."""
    known = _environments()
    if task.name not in known:
        raise ValueError(f"the task {task.name!r} has its rewards from frames: pass them as `rewards`.")
    return _read_only(known[task.name]().state_rewards())


def _read_only(rewards: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return the array, which nobody can change any more: many processes share it."""
    rewards.flags.writeable = False
    return rewards


@lru_cache(maxsize=16)
def _transitions(task: Task) -> _Transitions:
    """Return the states after actions (n_states, n_actions), displacements (n_states, n_displacements)."""

    def after(moves: list[Move]) -> npt.NDArray[np.intp]:
        return np.array(
            [[task.index(pose.moved(move, task.limits)) for move in moves] for pose in task.states]
        )

    return after([action.move for action in task.actions]), after(list(task.displacements))


def _task(task: str | Task) -> Task:
    if isinstance(task, Task):
        return task
    known = _environments()
    if not isinstance(task, str) or task not in known:
        raise unknown("task", task, tuple(known))
    return known[task].task


def _environments() -> dict[str, type[GuidanceEnv]]:
    """Return the environments that are registered here, by the name of their task."""
    specs = [spec for spec in gym.registry.values() if spec.namespace == "usbench"]
    classes: list[Any] = [
        load_env_creator(spec.entry_point) for spec in specs if isinstance(spec.entry_point, str)
    ]
    return {cls.task.name: cls for cls in classes if isinstance(cls, type) and issubclass(cls, GuidanceEnv)}
