"""The verdict of the results on the paper's question: do other methods do better than its policy gradient?"""

from collections.abc import Sequence

import pandas as pd

from usbench.results import scores
from usbench.results.tables import Results

PAPERS_OWN = "vpg"
BETTER = "other methods do better than the paper's vanilla policy gradient"
NONE_BETTER = "no other method does better than the paper's vanilla policy gradient"
OPEN = f"whether {BETTER} is open"


def text(known: Results) -> str:
    """Return two sentences: which agent comes closest to the optimum, and how others compare with `vpg`.

    Where some have several seeds, those with one are named in a third.
    """
    known = next(iter(scores.parts(known).values()))
    learning = known.trials[known.trials["steps"] > 0]
    finished = int((learning["status"] == "finished").sum())
    matrices = scores.learners(known)
    if not matrices:
        return (
            f"{_capital(OPEN)}: no algorithm has finished trials in every cell. "
            f"{finished} of {len(learning)} trials are finished; `usbench compare`, run again, adds the rest."
        )
    alone = [algo for algo, matrix in matrices.items() if len(matrix) == 1]
    if len(alone) < len(matrices):
        matrices = {algo: matrix for algo, matrix in matrices.items() if algo not in alone}
    else:
        alone = []
    table = scores.overall(matrices).set_index("agent")
    n_cells = next(iter(matrices.values())).shape[1]
    first = _best(table, n_cells)
    second = _against_the_papers_own(table, scores.improvement(matrices))
    if finished < len(learning):
        first = f"so far ({finished} of {len(learning)} trials are finished) {first}"
        second = f"on that evidence {second}"
    third = f" One seed tells nothing of the spread, so that {_names(alone)} must wait." if alone else ""
    return f"{_capital(first)} {_capital(second)}{third}"


def _best(table: pd.DataFrame, n_cells: int) -> str:
    best = table.iloc[0]
    cells = "the only cell" if n_cells == 1 else f"{n_cells} cells"
    seeds = "one seed" if best["seeds"] == 1 else f"{int(best['seeds'])} seeds"
    score = (
        f"a normalised score of {_score(best)} over {cells} with {seeds} (0 is a random hand, 1 the optimum)"
    )
    if len(table) == 1:
        return f"only `{best.name}` has finished trials in every cell, with {score}."
    tied = [algo for algo, row in table.iloc[1:].iterrows() if not _above(best, row)]
    tie = f"; {_names(tied)} cannot be told apart from it" if tied else ""
    return f"`{best.name}` comes closest to the optimum, with {score}{tie}."


def _against_the_papers_own(table: pd.DataFrame, improvement: pd.DataFrame) -> str:
    if PAPERS_OWN not in table.index:
        return f"{OPEN}: `{PAPERS_OWN}` lacks finished trials in some cell."
    others, own = table.drop(PAPERS_OWN), table.loc[PAPERS_OWN]
    if others.empty:
        return f"{OPEN}: no other has finished trials in every cell."
    above = [algo for algo, row in others.iterrows() if _above(row, own)]
    below = [algo for algo, row in others.iterrows() if _above(own, row)]
    rest = [algo for algo in others.index if algo not in {*above, *below}]
    if above:
        verdict = f"{BETTER} (`{PAPERS_OWN}`, {_score(own)})"
    elif rest:
        verdict = f"whether {BETTER} (`{PAPERS_OWN}`, {_score(own)}) cannot be told from these seeds"
    else:
        verdict = f"{NONE_BETTER} (`{PAPERS_OWN}`, {_score(own)})"
    clauses = [
        f"{_names(algos)} {'lies' if len(algos) == 1 else 'lie'} {where}"
        for algos, where in (
            (above, "above it"),
            (below, "below it"),
            (rest, "too close for these seeds"),
        )
        if algos
    ]
    pair = improvement[(improvement["agent"] == others.index[0]) & (improvement["other"] == PAPERS_OWN)].iloc[
        0
    ]
    interval = "" if pd.isna(pair["low"]) else f" [{pair['low']:.2f}, {pair['high']:.2f}]"
    chance = f"{pair['probability']:.2f}{interval}"
    return (
        f"{verdict}: {', '.join(clauses)}; a trial of `{others.index[0]}` beats one of `{PAPERS_OWN}` "
        f"with probability {chance}."
    )


def _above(row: pd.Series, other: pd.Series) -> bool:
    """Return whether the interval of `row` lies above the other's; a single seed has none."""
    return bool(row["score_low"] > other["score_high"])


def _score(row: pd.Series) -> str:
    if pd.isna(row["score_low"]):
        return f"{row['score']:.2f}"
    return f"{row['score']:.2f} [{row['score_low']:.2f}, {row['score_high']:.2f}]"


def _names(algos: Sequence[str]) -> str:
    quoted = [f"`{algo}`" for algo in algos]
    return quoted[0] if len(quoted) == 1 else f"{', '.join(quoted[:-1])} and {quoted[-1]}"


def _capital(sentence: str) -> str:
    return sentence[0].upper() + sentence[1:]
