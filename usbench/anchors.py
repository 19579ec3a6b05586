"""The exact returns between which a score is measured, and the one place where a return becomes a score."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Self, TypeVar

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    Return = TypeVar("Return", float, npt.NDArray[np.float64])


@dataclass(frozen=True)
class Anchors:
    """Expected undiscounted returns of an episode, the mean over its starts.

    Attributes:
        optimal: Of the best policy that knows the pose.
        random: Of actions drawn uniformly.
        stay: Of never moving.
    """

    optimal: float
    random: float
    stay: float

    @classmethod
    def mean(cls, several: Sequence[Self], weights: Sequence[float] | None = None) -> Self:
        """Return the means of the expected returns, weighted where there are weights."""
        import numpy as np  # records are read without it

        names = [field.name for field in fields(cls)]
        return cls(
            **{
                name: float(np.average([getattr(one, name) for one in several], weights=weights))
                for name in names
            }
        )

    def score(self, return_: Return) -> Return:
        """Return the normalised score of a return or of an array of returns: 0 is random, 1 is optimal."""
        return (return_ - self.random) / (self.optimal - self.random)

    def return_of(self, score: Return) -> Return:
        """Return the return that has this normalised score: `score` the other way round."""
        return score * (self.optimal - self.random) + self.random
