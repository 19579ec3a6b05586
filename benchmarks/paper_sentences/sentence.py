"""A sentence of the paper beside our numbers, and the words for whether it holds."""

from collections.abc import Sequence
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

    def markdown(self) -> str:
        """Return its section."""
        rule = f"{self.rule[0].lower()}{self.rule[1:]}"
        return f"## “{self.words}”\n\n**{self.holds.capitalize()}.** The rule: {rule}\n\n{self.numbers}"


def verdict_of(n_true: int, n_all: int) -> str:
    """Return whether a sentence holds that is true of so many trials."""
    return HOLDS if n_true == n_all else FAILS if n_true == 0 else PARTLY


def of_intervals(differences: Sequence[Interval]) -> str:
    """Return whether a sentence holds that says of differences that each is above 0."""
    each = {HOLDS if one.low > 0 else FAILS if one.high < 0 else OPEN for one in differences}
    return each.pop() if len(each) == 1 else OPEN if OPEN in each else PARTLY
