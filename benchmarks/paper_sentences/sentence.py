"""A sentence of the paper beside our numbers, and the words for whether it holds."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from usbench.results import verdict
from usbench.results.stats import Interval

AGENT = verdict.PAPERS_OWN
HOLDS, FAILS, PARTLY, OPEN = "holds", "does not hold", "holds in part", "cannot be told"


@dataclass(frozen=True)
class Sentence:
    """A sentence of the paper, whether it holds here, by which rule, and the numbers."""

    words: str
    rule: str
    holds: str
    numbers: str


def first(each: Mapping[str, Sentence]) -> Sentence:
    """Return one of the same sentence beside the numbers of several agents."""
    return next(iter(each.values()))


def section(each: Mapping[str, Sentence]) -> str:
    """Return the section of a sentence, by agent: the rule, whether it holds, and the numbers."""
    rule = first(each).rule
    parts = [f"## “{first(each).words}”", f"The rule: {rule[0].lower()}{rule[1:]}"]
    for agent, one in each.items():
        parts += [f"**With {agent}: {one.holds}.**", one.numbers]
    return "\n\n".join(parts)


def verdict_of(n_true: int, n_all: int) -> str:
    """Return whether a sentence holds that is true of so many trials."""
    return HOLDS if n_true == n_all else FAILS if n_true == 0 else PARTLY


def of_intervals(differences: Sequence[Interval]) -> str:
    """Return whether a sentence holds that says of differences that each is above 0."""
    each = {HOLDS if one.low > 0 else FAILS if one.high < 0 else OPEN for one in differences}
    return each.pop() if len(each) == 1 else OPEN if OPEN in each else PARTLY
