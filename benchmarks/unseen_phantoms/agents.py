"""Rows of `double_dqn` with one thing changed that is no hyperparameter."""

from dataclasses import replace
from typing import Any

from usbench.agents import zoo
from usbench.agents.rows.entry import RUNNING, TRUNK, Entry
from usbench.agents.value_based.double_dqn import DoubleDQN

AGENT = "double_dqn"
ROW = zoo.ZOO[AGENT]


class WithoutViews(DoubleDQN):
    """The agent without symmetries: neither in what it remembers nor in its network."""

    takes_symmetries = False


class SomeViews(DoubleDQN):
    """The agent with some of the symmetries of its task."""

    def __init__(
        self, policy: Any, env: Any, *, numbers: tuple[int, ...] = (0,), symmetries: Any = None, **kwargs: Any
    ) -> None:
        """Takes the arguments of `DoubleDQN`; `numbers` are the places of the symmetries that it has."""
        if symmetries is not None:
            names = ("mirrored", "sources", "signs", "actions")
            chosen = {name: getattr(symmetries, name)[list(numbers)] for name in names}
            symmetries = replace(symmetries, **chosen)
        super().__init__(policy, env, symmetries=symmetries, **kwargs)


class WithoutDrawnViews(DoubleDQN):
    """The agent whose network has the symmetries, while it learns from what it remembers as it was."""

    def _viewed(self, observations: Any, actions: Any, following: Any) -> tuple[Any, Any, Any]:
        return self._shifted(observations), actions, self._shifted(following)


def _of(cls: type) -> Entry:
    return replace(ROW, cls=f"{__name__}:{cls.__name__}")


def _remembering(*numbers: int) -> Entry:
    """The row with these symmetries in what it remembers; its network sees observations as they are."""
    return replace(
        _of(SomeViews),
        kwargs={"numbers": numbers},
        policy_kwargs={**ROW.policy_kwargs, "canonical": False},
    )


def _with_trunk(**settings: Any) -> Entry:
    """The row with other settings of its `GridTrunk`."""
    return replace(ROW, policy_kwargs={**ROW.policy_kwargs, "features_extractor_kwargs": settings})


NO_VIEWS = _of(WithoutViews)
# By the places that the symmetries of a tracked probe plane have, the first of which changes nothing.
ANGLES_NEGATED = _remembering(0, 1)
TURNED_MIRRORED = _remembering(0, 2)
TURNED_X_NEGATED = _remembering(0, 4)
ALL_REMEMBERED = _remembering(*range(8))
ALL_IN_NETWORK = _of(WithoutDrawnViews)

PAPERS_TRUNK = replace(ROW, policy_kwargs={**TRUNK, **RUNNING})
ONE_AVERAGE = _with_trunk(grid=(1, 1))
LAYER_NORM = _with_trunk(groups=1)
NO_NORM = _with_trunk(groups=0)
