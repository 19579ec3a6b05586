"""A teacher that knows no more than can be known: the costs of actions by the best policy over beliefs.

The oracle knows what no picture tells, and who imitates it learns the mean of opposite actions. The teacher
has ideal eyes and a perfect memory, and nothing else: where two poses look alike it tries a turn and looks.

Where a task moves the focus too, what is known of the object's depth is kept beside a belief (`depths.py`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import sparse

from usbench.anchors import Anchors
from usbench.checks import probability
from usbench.envs import oracle
from usbench.envs.ceilings import hypotheses
from usbench.envs.ceilings.beliefs import BeliefGraph, belief_graph
from usbench.envs.ceilings.depths import Depths, Floats, focus_held
from usbench.envs.ceilings.hypotheses import Hypotheses, Ints
from usbench.envs.observation import senses as sensing
from usbench.envs.pose import Pose
from usbench.envs.task import Task
from usbench.envs.tasks.phantom_distribution import PhantomDistribution

Infos = Sequence[Mapping[str, Any]]


@dataclass(frozen=True, eq=False)
class Teacher:
    """What every action costs, by the best policy for what has been seen since the episode began.

    A student does not know how many steps are left, and neither does the policy: it plans for as many as a
    whole episode has, at every step. Nothing is computed before the teacher is asked (seconds).

    Attributes:
        task: The task.
        phantoms: What its phantoms are drawn from.
        senses: What the student is told; the teacher knows its own actions in any case.
        noise: Probability of a displacement after each action.
        eyes: What other eyes see of what ideal eyes tell apart; None for ideal eyes.

    Raises:
        ValueError: If noise or a focus that moves leaves the teacher in doubt about the probe's own pose.
    """

    task: Task
    phantoms: PhantomDistribution
    senses: tuple[str, ...]
    noise: float = 0.0
    eyes: Callable[[Hypotheses], Hypotheses] | None = None

    def __post_init__(self) -> None:
        """Check that beliefs can be listed."""
        object.__setattr__(self, "noise", probability("noise", self.noise))
        why = "noise" if self.noise else "a focus that moves" if self.task.moves_focus else None
        if why:
            sensing.check_pose_told(self.senses, self.task, f"with {why}, a teacher")

    @property
    def stay(self) -> int:
        """The action that moves nothing."""
        return self.task.stay

    def first(self, infos: Infos) -> Ints:
        """Return the beliefs (n,) after the first frames of episodes that begin where `infos` say.

        Raises:
            ValueError: If an episode begins where none of the task does.
        """
        belief = self._first_of[self._observed[self._hypotheses(infos)]]
        if (belief < 0).any():
            raise ValueError(f"episodes must begin where those of the task {self.task.name!r} do.")
        return self._with_depth(belief, np.zeros(len(belief), np.bool_), infos)

    def following(self, beliefs: Ints, actions: Ints, infos: Infos) -> Ints:
        """Return the beliefs (n,) after `actions` have led where `infos` say."""
        before, column = np.divmod(beliefs, self._depths.n_columns)
        seen = self._observed[self._hypotheses(infos)]
        steps = zip(before.tolist(), actions.tolist(), seen.tolist(), strict=True)
        after = np.array([self._children[step] for step in steps], dtype=np.int64)
        return self._with_depth(after, column < self._depths.n_known, infos)

    def costs(self, beliefs: Ints) -> npt.NDArray[np.float32]:
        """Return what each action loses of the return to the end against the best one, (n, n_actions)."""
        return self._costs[beliefs]

    @cached_property
    def best_return(self) -> float:
        """The mean return over the starts of the best policy that remembers all and counts its steps."""
        return self._over_starts(self._plan(self.task.n_steps)[0])

    @cached_property
    def best_score(self) -> float:
        """The score of `best_return`: 0 for random actions, 1 for the best policy that knows all."""
        depths = self.phantoms.depth_mm if self.task.moves_focus else (self.known.targets[0].focal_depth_mm,)
        found = [
            oracle.returns(self.task, self.noise, target=replace(target, focal_depth_mm=depth))
            for target in self.known.targets
            for depth in depths
        ]
        return Anchors.mean(found).score(self.best_return)

    @cached_property
    def known(self) -> Hypotheses:
        """Poses and objects, with the focus held where objects lie in the middle of their depths."""
        depth = self.phantoms.depth_mm[len(self.phantoms.depth_mm) // 2]
        ideal = hypotheses.of_distribution(focus_held(self.task, depth), self.phantoms)
        return ideal if self.eyes is None else self.eyes(ideal)

    @cached_property
    def _observed(self) -> Ints:
        of_pose = tuple(name for name in self.senses if name not in ("focus", sensing.ACTIONS))
        return self.known.observed(of_pose)

    @cached_property
    def _graph(self) -> BeliefGraph:
        return belief_graph(self.known, self._observed, displaces=self.noise > 0)

    @cached_property
    def _depths(self) -> Depths:
        return Depths.of(self.task, self.phantoms)

    @cached_property
    def _sees_object(self) -> npt.NDArray[np.bool_]:
        """Whether the object is seen in each belief, (n_beliefs,)."""
        shows = np.zeros(int(self._observed.max()) + 1, np.bool_)
        shows[self._observed] = self.known.shows.ravel()
        return shows[self._graph.seen]

    @cached_property
    def _first_of(self) -> Ints:
        found = np.full(int(self._observed.max()) + 1, -1, np.int64)
        found[self._graph.seen[self._graph.first]] = self._graph.first
        return found

    @cached_property
    def _children(self) -> dict[tuple[int, int, int], int]:
        """The belief that follows a belief, an action and what is observed then."""
        return {
            (int(before), action, int(self._graph.seen[after])): int(after)
            for action, of_action in enumerate(self._graph.edges)
            for outcome in of_action
            for before, after in outcome
        }

    @cached_property
    def _costs(self) -> npt.NDArray[np.float32]:
        q = self._plan(self.task.n_steps)[1]
        costs = (q.max(axis=2, keepdims=True) - q) / self._graph.sizes[:, np.newaxis, np.newaxis]
        # Rounding must not decide between equally good actions.
        return np.where(costs < 1e-9, 0.0, costs).astype(np.float32).reshape(-1, q.shape[2])

    def _plan(self, n_steps: int) -> tuple[Floats, Floats]:
        """Return values with `n_steps` left, (n_beliefs, n_columns), and those of every action; sums."""
        values = np.zeros((len(self._graph.sizes), self._depths.n_columns))
        every: list[Floats] = []
        for _ in range(n_steps):
            arrived = self._arrived(values)
            every = [self._q(action, arrived) for action in range(len(self.task.actions))]
            values = np.maximum.reduce(every)
        return values, np.stack(every, axis=2)

    def _q(self, action: int, arrived: Floats) -> Floats:
        """Return the value of an action in every belief, (n_beliefs, n_columns), from values on arrival."""
        depths, graph = self._depths, self._graph
        moved = depths.following[action]
        of_focus = graph.sizes[:, np.newaxis] * depths.rewards[moved]
        q: Floats = graph.rewards[:, [action]] + of_focus
        for weights, columns in self._steps[action]:
            q += weights @ arrived[:, columns]
        return q

    @cached_property
    def _steps(self) -> list[list[tuple[sparse.csr_array, Ints]]]:
        """Of each action: probabilities from belief to belief, and where columns go meanwhile."""
        n = len(self._graph.sizes)
        shares = [1.0]
        if self.noise:
            n_displaced = len(self.task.displacements)
            shares = [1 - self.noise] + [self.noise / n_displaced] * n_displaced
        found = []
        for action, of_action in enumerate(self._graph.edges):
            together: dict[bytes, tuple[Any, Ints]] = {}
            for k, (share, (before, after)) in enumerate(
                zip(shares, (edges.T for edges in of_action), strict=True)
            ):
                columns = self._depths.following[action]
                columns = self._depths.displaced[k - 1][columns] if k else columns
                weights = sparse.csr_array((np.full(len(before), share), (before, after)), shape=(n, n))
                known = together.get(columns.tobytes())
                together[columns.tobytes()] = (weights if known is None else known[0] + weights, columns)
            found.append(list(together.values()))
        return found

    def _arrived(self, values: Floats) -> Floats:
        """Return values on arrival in a belief: who sees the object knows from then on how deep it lies."""
        n_known, n_depths = self._depths.n_known, self._depths.n_depths
        arrived = values.copy()
        by_depth = values[self._sees_object, :n_known].reshape(-1, n_known // n_depths, n_depths)
        arrived[self._sees_object, n_known:] = by_depth.mean(axis=2)
        return arrived

    def _over_starts(self, values: Floats) -> float:
        arrived = self._arrived(values)[self._graph.first, self._depths.n_known :].sum(axis=0)
        return float(arrived @ self._depths.starts) / len(self.known.starts)

    def _hypotheses(self, infos: Infos) -> Ints:
        """Return the true hypotheses, (n,)."""
        known = self.known
        depth = known.task.states[0].focal_depth_mm
        return np.array(
            [
                known.task.indices[Pose(one["x_mm"], depth, one["angle_deg"])] * len(known.targets)
                + self.known.places[one["target_x_mm"], one["target_angle_deg"] % 180]
                for one in infos
            ],
            dtype=np.int64,
        )

    def _with_depth(self, belief: Ints, knew: npt.NDArray[np.bool_], infos: Infos) -> Ints:
        """Return beliefs with what is known of the focus; `knew` says whether the object was seen before."""
        depths, knows = self._depths, knew | self._sees_object[belief]
        columns = [
            depths.column(one["focal_depth_mm"], one["target_focal_depth_mm"] if is_known else None)
            for one, is_known in zip(infos, knows, strict=True)
        ]
        return belief * depths.n_columns + np.array(columns, dtype=np.int64)


@lru_cache(maxsize=1)
def teacher(task: Task, phantoms: PhantomDistribution, senses: tuple[str, ...], noise: float) -> Teacher:
    """Return a teacher, the last one again where it is the same: all that it computes is kept."""
    return Teacher(task, phantoms, senses, noise)
