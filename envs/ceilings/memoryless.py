"""Policies that see the last few frames alone: how well they can do at least.

A policy without further memory gives every observation its own probabilities of actions. The best one is hard
to find exactly (Littman 1994), so that what is computed is a lower bound of the ceiling: exact natural
policy gradients (Kakade 2002), from several beginnings, over the expected return of all starts, and the
return of the policy that was found, exact to rounding.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
import numpy.typing as npt
from scipy.special import softmax

from usbench.envs.ceilings.hypotheses import Hypotheses, Ints

Floats = npt.NDArray[np.float64]
_FIRST_STEP, _GROWTH, _LONGEST = 0.5, 1.05, 30.0  # of a gradient, in logits per unit of return


@dataclass(frozen=True, eq=False)
class Histories:
    """Hypotheses with the actions that led there, as far back as a policy sees.

    Attributes:
        following: The history after every action, (n_histories, n_actions).
        rewards: The reward of being there, (n_histories,).
        starts: Those with which an episode begins.
        observed: What a policy sees there, a number for every history.
    """

    following: Ints
    rewards: Floats
    starts: Ints
    observed: Ints


def histories(
    known: Hypotheses, senses: tuple[str, ...], n_frames: int = 1, with_actions: bool = False
) -> Histories:
    """Return all that a policy of `n_frames` frames tells apart, or not.

    Args:
        known: Poses and objects.
        senses: What is told at every one of the frames.
        n_frames: How many frames the policy sees, the last ones; before the first it sees the first again.
        with_actions: Whether the policy is told the actions between the frames too; of one frame, the action
            that led there.
    """
    n_hypotheses, n_actions = known.following.shape
    none = n_actions  # stands for the time before the episode, in which nothing moves
    moves = np.concatenate([known.following, np.arange(n_hypotheses)[:, np.newaxis]], axis=1)
    # A history is the hypothesis so many steps ago with the actions since, the oldest first.
    n_past = max(n_frames - 1, int(with_actions))
    pasts = list(product(range(none + 1), repeat=n_past))
    number = {past: k for k, past in enumerate(pasts)}
    past = np.array(pasts, dtype=np.int64).reshape(len(pasts), n_past)

    seen = known.observed(senses)
    at = np.repeat(np.arange(n_hypotheses)[:, np.newaxis], len(pasts), axis=1)
    signs = [seen[at]]
    for actions in past.T:
        at = moves[at, actions]
        signs.append(seen[at])
    signs = signs[-n_frames:]
    if with_actions:
        signs += [np.broadcast_to(actions, at.shape) for actions in past.T]
    observed = np.unique(np.stack([sign.ravel() for sign in signs]), axis=1, return_inverse=True)[1]

    # After an action the oldest one is made, and the new one is the last; where none is kept, none is made.
    oldest = moves[:, past[:, 0]] if n_past else None
    following = np.empty((n_hypotheses, len(pasts), n_actions), dtype=np.int64)
    for action in range(n_actions):
        later = np.array([number[(*one, action)[1:]] for one in pasts])
        after = known.following[:, [action]] if oldest is None else oldest
        following[:, :, action] = after * len(pasts) + later
    return Histories(
        following.reshape(-1, n_actions),
        known.rewards[at].ravel(),
        known.starts * len(pasts) + number[(none,) * n_past],
        observed.ravel().astype(np.int64),
    )


def found_return(past: Histories, n_steps: int, rng: np.random.Generator, n_updates: int = 300) -> float:
    """Return the mean return over the starts of the policy that gradients find from one random beginning."""
    n_observations, n_actions = int(past.observed.max()) + 1, past.following.shape[1]
    logits = rng.normal(0.0, 1.0, (n_observations, n_actions))
    step, best, kept = _FIRST_STEP, -np.inf, logits
    for _ in range(n_updates):
        mean_return, gradient = _evaluated(past, n_steps, softmax(logits, axis=1))
        if mean_return < best - 1e-9:  # a step too far: back, and shorter ones
            logits, step = kept, step / 4
            mean_return, gradient = _evaluated(past, n_steps, softmax(logits, axis=1))
        best, kept = mean_return, logits
        logits = logits + step * gradient
        logits -= logits.max(axis=1, keepdims=True)
        step = min(step * _GROWTH, _LONGEST)
    return best


def _evaluated(past: Histories, n_steps: int, policy: Floats) -> tuple[float, Floats]:
    """Return a policy's mean return over the starts, and the advantage of each action where it is observed.

    That is the natural gradient in logits: the advantages, weighted with how often a history is met.
    """
    n_observations, n_actions = policy.shape
    chosen = policy[past.observed]
    values = np.zeros((n_steps + 1, len(past.rewards)))
    for t in reversed(range(n_steps)):
        earned = past.rewards + values[t + 1]
        values[t] = np.einsum("ha,ha->h", chosen, earned[past.following])
    met: Floats = np.zeros(len(past.rewards))
    met[past.starts] = 1 / len(past.starts)
    weights, advantages = np.zeros(n_observations), np.zeros((n_observations, n_actions))
    for t in range(n_steps):
        live = np.flatnonzero(met)
        share, after = met[live], past.following[live]
        gains = (past.rewards + values[t + 1])[after] - values[t][live, np.newaxis]
        weights += np.bincount(past.observed[live], share, n_observations)
        for action in range(n_actions):
            advantages[:, action] += np.bincount(
                past.observed[live], share * gains[:, action], n_observations
            )
        flow = share[:, np.newaxis] * chosen[live]
        met = np.asarray(np.bincount(after.ravel(), flow.ravel(), len(met)), dtype=np.float64)
    mean_return = float(values[0][past.starts].mean())
    return mean_return, advantages / np.maximum(weights, 1e-12)[:, np.newaxis]
