"""The best policy that remembers every frame, sense and action: a dynamic programme over beliefs.

Without noise, moves and what is seen follow from the hypothesis alone. What is known after any history is
then the set of hypotheses that fit it, all as likely as they were at first, and the best return is that of a
Markov decision process whose states are these sets (Astrom 1965; Kaelbling, Littman and Cassandra 1998). The
sets shrink from frame to frame, so that all that can be reached are few enough to be listed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from usbench.envs.ceilings.hypotheses import Hypotheses, Ints


@dataclass(frozen=True)
class BeliefGraph:
    """Beliefs that can be reached, and where actions lead.

    Attributes:
        first: The beliefs after the first frame.
        rewards: Sum over a belief's hypotheses of the reward after an action, (n_beliefs, n_actions).
        edges: Of every action, belief and one of those that may follow it, (n_edges, 2) each.
    """

    first: Ints
    rewards: npt.NDArray[np.float64]
    edges: tuple[Ints, ...]


def best_return(known: Hypotheses, senses: tuple[str, ...]) -> float:
    """Return the mean return over the starts of the best policy that remembers frames, senses and actions."""
    graph = belief_graph(known, known.observed(senses))
    n_beliefs, n_actions = graph.rewards.shape
    values = np.zeros(n_beliefs)
    for _ in range(known.task.n_steps):
        q = graph.rewards.copy()
        for action in range(n_actions):
            before, after = graph.edges[action].T
            q[:, action] += np.bincount(before, values[after], minlength=n_beliefs)
        values = q.max(axis=1)
    return float(values[graph.first].sum() / len(known.starts))


def belief_graph(known: Hypotheses, observed: Ints) -> BeliefGraph:
    """List all beliefs that an episode can reach.

    A belief is known by the sum of random 64-bit numbers of its hypotheses (Zobrist 1970), so that two of a
    million are taken for one with a probability below 1e-7.
    """
    names = np.random.default_rng(0).integers(0, 2**63, len(known.rewards), dtype=np.uint64)
    number_of: dict[int, int] = {}
    rewards: list[npt.NDArray[np.float64]] = []
    edges: list[list[Ints]] = [[] for _ in known.task.actions]
    members, belief = _divided(known.starts, np.zeros(len(known.starts), np.int64), observed)
    first, members, belief = _numbered(members, belief, names, number_of)
    for _ in range(known.task.n_steps):
        if not len(members):
            break
        low = int(belief.min())
        n_new = int(belief.max()) - low + 1
        block = np.zeros((n_new, len(known.task.actions)))
        later_members, later_beliefs = [], []
        for action in range(len(known.task.actions)):
            moved = known.following[members, action]
            block[:, action] = np.bincount(belief - low, known.rewards[moved], minlength=n_new)
            after, group = _divided(moved, belief, observed)
            origin = belief[np.argsort(_keys(belief, observed[moved]), kind="stable")]
            _, starts = np.unique(group, return_index=True)
            children, fresh, fresh_belief = _numbered(after, group, names, number_of)
            edges[action].append(np.stack([origin[starts], children], axis=1))
            later_members.append(fresh)
            later_beliefs.append(fresh_belief)
        rewards.append(block)
        members, belief = np.concatenate(later_members), np.concatenate(later_beliefs)
    n_beliefs = len(number_of)
    listed = np.concatenate(rewards)
    every = np.zeros((n_beliefs, listed.shape[1]))  # those that only the last step reaches earn nothing more
    every[: len(listed)] = listed
    return BeliefGraph(first, every, tuple(np.concatenate(one) for one in edges))


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
