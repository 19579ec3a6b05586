"""The best policy that remembers every frame, sense and action: a dynamic programme over beliefs.

Moves and what is seen follow from the hypothesis alone, but for displacements, and those are seen where the
pose is told. What is known after any history is then the set of hypotheses that fit it, all as likely as they
were at first, and the best return is that of a Markov decision process whose states are these sets (Astrom
1965; Kaelbling, Littman and Cassandra 1998). The sets shrink from frame to frame, so that all that can be
reached are few enough to be listed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from usbench.envs.ceilings.hypotheses import Hypotheses, Ints


@dataclass(frozen=True)
class BeliefGraph:
    """Beliefs that can be reached in any number of steps, and where actions lead.

    Attributes:
        first: The beliefs after the first frame.
        sizes: How many hypotheses each holds, (n_beliefs,).
        seen: What is observed in each, a number of `observed`, (n_beliefs,).
        rewards: Sum over a belief's hypotheses of the reward after an action, (n_beliefs, n_actions).
        edges: Of every action and then every outcome (no displacement, then each of those there may be),
            pairs of a belief and one that may follow it, (n_edges, 2).
    """

    first: Ints
    sizes: Ints
    seen: Ints
    rewards: npt.NDArray[np.float64]
    edges: tuple[tuple[Ints, ...], ...]


def best_return(known: Hypotheses, senses: tuple[str, ...]) -> float:
    """Return the mean return over the starts of the best policy that remembers frames, senses and actions."""
    graph = belief_graph(known, known.observed(senses))
    n_beliefs, n_actions = graph.rewards.shape
    values = np.zeros(n_beliefs)
    for _ in range(known.task.n_steps):
        q = graph.rewards.copy()
        for action in range(n_actions):
            before, after = graph.edges[action][0].T
            q[:, action] += np.bincount(before, values[after], minlength=n_beliefs)
        values = q.max(axis=1)
    return float(values[graph.first].sum() / len(known.starts))


def belief_graph(known: Hypotheses, observed: Ints, displaces: bool = False) -> BeliefGraph:
    """List all beliefs that can be reached.

    A belief is known by the sum of random 64-bit numbers of its hypotheses (Zobrist 1970), so that two of a
    million are taken for one with a probability below 1e-7.

    Args:
        known: The hypotheses.
        observed: What is observed at each, (n_hypotheses,); with displacements it must tell the pose.
        displaces: Whether the task's displacements may follow an action.
    """
    names = np.random.default_rng(0).integers(0, 2**63, len(known.rewards), dtype=np.uint64)
    number_of: dict[int, int] = {}
    landings = [np.arange(len(known.rewards)), *(known.displaced.T if displaces else ())]
    edges: list[list[list[Ints]]] = [[[] for _ in landings] for _ in known.task.actions]
    members, belief = _divided(known.starts, np.zeros(len(known.starts), np.int64), observed)
    first, members, belief = _numbered(members, belief, names, number_of)
    every = [(members, belief)]
    while len(members):
        later = []
        for action, of_action in enumerate(edges):
            for landing, of_outcome in zip(landings, of_action, strict=True):
                landed = landing[known.following[members, action]]
                after, group = _divided(landed, belief, observed)
                origin = belief[np.argsort(_keys(belief, observed[landed]), kind="stable")]
                _, starts = np.unique(group, return_index=True)
                children, fresh, fresh_belief = _numbered(after, group, names, number_of)
                of_outcome.append(np.stack([origin[starts], children], axis=1))
                later.append((fresh, fresh_belief))
        members, belief = (np.concatenate(part) for part in zip(*later, strict=True))
        every.append((members, belief))
    members, belief = (np.concatenate(part) for part in zip(*every, strict=True))
    return BeliefGraph(
        first,
        np.bincount(belief),
        _of_each(belief, observed[members]),
        np.stack([np.bincount(belief, known.rewards[after]) for after in known.following[members].T], axis=1),
        tuple(tuple(np.concatenate(one) for one in of_action) for of_action in edges),
    )


def _of_each(belief: Ints, values: Ints) -> Ints:
    """Return the value that the members of each belief share, (n_beliefs,)."""
    return values[np.unique(belief, return_index=True)[1]]


def _keys(belief: Ints, observation: Ints) -> Ints:
    """Return a number for every pair of belief and observation."""
    return belief * (int(observation.max()) + 1) + observation


def _divided(members: Ints, belief: Ints, observed: Ints) -> tuple[Ints, Ints]:
    """Divide beliefs by what their members show: members by group, and the group of each from 0 on."""
    keys = _keys(belief, observed[members])
    order = np.argsort(keys, kind="stable")
    return members[order], np.unique(keys[order], return_inverse=True)[1].ravel()


def _numbered(
    members: Ints, group: Ints, names: npt.NDArray[np.uint64], number_of: dict[int, int]
) -> tuple[Ints, Ints, Ints]:
    """Return the number of every group's belief, and members and numbers of those that were not known."""
    _, starts = np.unique(group, return_index=True)
    sums = np.add.reduceat(names[members], starts)
    before = len(number_of)
    numbers = np.array([number_of.setdefault(int(one), len(number_of)) for one in sums], dtype=np.int64)
    # A belief that stands here twice is new once.
    is_first = np.zeros(len(numbers), dtype=np.bool_)
    is_first[np.unique(numbers, return_index=True)[1]] = True
    is_new = ((numbers >= before) & is_first)[group]
    return numbers, members[is_new], numbers[group][is_new]
