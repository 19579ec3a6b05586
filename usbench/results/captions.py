"""The figures that stand on the leaderboard's page, with words that say of which tasks each of them is."""

from pathlib import Path
from urllib.parse import quote

import pandas as pd

from usbench.results import ranking, scores, text
from usbench.results.protocol import further
from usbench.results.tables import Results
from usbench.tasks import PAPER

# Of each part of the results: the end of a figure's name, and what it shows of which tasks.
FIGURES = (
    ("scores", "Score of every agent in every cell of {}, with its interval"),
    ("learning_curves", "Score over training steps in every cell of {}, with its interval"),
    (
        "improvement",
        "How likely a trial of one agent has a higher score than a trial of another agent in the same cell "
        "of {}, for every pair: thick lines are 95 % intervals, thin lines (from "
        f"{ranking.MIN_SEEDS} seeds on) those corrected for all pairs",
    ),
)
# Folded, as it says more than a first look needs.
FOLDED = ("learning_curves_cpu", "Score over CPU time of training in every cell of {}, with its interval")
SUMMARY = "Score over CPU time of training"


def links(known: Results, folder: Path, shown_as: str) -> dict[str, list[str]]:
    """Return those figures of each part of the results that are drawn in `folder`, as Markdown.

    Args:
        known: The results.
        folder: Where the figures are.
        shown_as: How the page calls that folder.
    """
    return {name: _links(name, own.trials, folder, shown_as) for name, own in scores.parts(known).items()}


def _links(part: str, trials: pd.DataFrame, folder: Path, shown_as: str) -> list[str]:
    where, found = _where(part, trials), {}
    for kind, words in (*FIGURES, FOLDED):
        file = f"{scores.prefix(part)}{kind}.png"
        if (folder / file).is_file():
            found[kind] = f"![{words.format(where)}]({quote(shown_as)}/{file})"
    if FOLDED[0] in found:
        found[FOLDED[0]] = text.folded(SUMMARY, found[FOLDED[0]])
    return list(found.values())


def _where(part: str, trials: pd.DataFrame) -> str:
    """Return in words of which tasks a part is, without code: sites leave that out of a picture's words."""
    if part in further.names():
        return f"the table {part}"
    learned = trials[trials["steps"] > 0]
    tasks = sorted(set((trials if learned.empty else learned)["task"]))
    return (
        "the paper's tasks" if tasks in ([], sorted(PAPER)) else text.in_a_row(list(map(text.escaped, tasks)))
    )
