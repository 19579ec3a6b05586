"""The verdict of the results on the paper's question: do other methods do better than its policy gradient?

One agent lies above another by one rule, `ranking.above`; no sentence on scores in the
cells says more than that rule does.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

import pandas as pd

from usbench import seed_pools
from usbench.results import held_out, ranking, scores
from usbench.results.agents import named
from usbench.results.protocol import further
from usbench.results.tables import Results
from usbench.results.text import capital, code, interval, names, number, pairs_of
from usbench.tasks import PAPER, row_of
from usbench.words import network_apart

PAPERS_OWN = "vpg"
# The same algorithm, with what the paper fixes searched as in all other rows.
PAPERS_OWN_TUNED = "vpg-tuned"
BETTER = "other methods do better than the paper's vanilla policy gradient"
NONE_BETTER = "no other method does better than the paper's vanilla policy gradient"
OPEN = f"whether {BETTER} is open"
SCALE = "where 0 is the random agent and 1 the optimum"


@dataclass(frozen=True)
class _Ranked:
    """Agents with their scores, best first and by name, and who lies above whom."""

    table: pd.DataFrame
    above: set[tuple[str, str]]
    pairs: pd.DataFrame

    def score(self, agent: str) -> str:
        """Return the score of an agent with its interval, in words."""
        row = self.table.loc[agent]
        return interval(row["score"], row["score_low"], row["score_high"], 2)

    def beside(self, agents: Sequence[str], own: str) -> list[str]:
        """Return how `agents` lie to `own`, in sentences."""
        kinds: tuple[tuple[Callable[[str], bool], str, str], ...] = (
            (lambda one: (one, own) in self.above, "lies above", "lie above"),
            (lambda one: (own, one) in self.above, "lies below", "lie below"),
            (
                lambda one: not {(one, own), (own, one)} & self.above,
                "cannot be told apart from",
                "cannot be told apart from",
            ),
        )
        sentences = []
        for holds, single, several in kinds:
            found = [one for one in agents if holds(one)]
            if found:
                sentences.append(f"{names(found)} {single if len(found) == 1 else several} {code(own)}.")
        return sentences


def text(known: Results, tested: pd.DataFrame | None = None) -> str:
    """Return `sentences` as one paragraph."""
    return " ".join(sentences(known, tested))


def sentences(known: Results, tested: pd.DataFrame | None = None) -> list[str]:
    """Return what a leaderboard says first: whose score is highest, and how others compare with `vpg`.

    Each item is a paragraph of sentences with a fact in each.

    With fewer than `ranking.MIN_SEEDS` seeds, a shorter budget than a task's, or seeds that are not kept for
    comparisons, it only names scores.

    Args:
        known: The results, of which the paper's tasks count where there are others.
        tested: The tests on unseen phantoms that `held_out.read` gives, if there are any.
    """
    own = next(iter(scores.parts(known).values()))
    learning = own.trials[scores.ranked(own.trials)]
    finished = int((learning["status"] == "finished").sum())
    matrices = scores.learners(own)
    if not matrices:
        return [" ".join(map(capital, _nothing(own, learning, finished)))]
    enough = {agent: matrix for agent, matrix in matrices.items() if len(matrix) >= ranking.MIN_SEEDS}
    waiting = {agent: len(matrix) for agent, matrix in matrices.items() if agent not in enough}
    kept = enough or matrices
    cells = scores.cells_of(learning)
    table = ranking.overall(kept).set_index("agent")
    reasons = [*_short(learning, kept), *([] if enough else [_few(waiting)]), *_seen(learning, kept)]
    table_name = next(iter(further.split(own)))
    where = _where(cells, table_name)
    if reasons:
        found = [_first_look(table, reasons, where)]
    else:
        pairs = ranking.improvement(kept)
        ranked = _Ranked(table, ranking.above(pairs), pairs)
        found = [
            _highest(ranked, where, waiting),
            *_against_the_papers_own(ranked, _is_part(cells, table_name)),
        ]
        named_here = {str(table.index[0]), PAPERS_OWN, PAPERS_OWN_TUNED}
        fewer = [two for two in sorted(ranking.above_by_cells_alone(pairs)) if named_here & {*two}]
        if fewer:
            found.append([f"with whole seeds drawn, it is not sure that {pairs_of(fewer)}."])
    if enough and waiting:
        found.append([f"with {_few(waiting)}, {names(list(waiting))} must wait."])
    if finished < len(learning):
        found[0].insert(0, f"so far {finished} of {len(learning)} trials are finished.")
    return [" ".join(map(capital, paragraph)) for paragraph in [*found, *_phantoms(own, tested)]]


def _nothing(own: Results, learning: pd.DataFrame, finished: int) -> list[str]:
    """Return in sentences why no agent has a score over all cells."""
    if finished < len(learning) or learning.empty:
        return [
            f"{OPEN}: no algorithm has finished trials in every cell.",
            f"{finished} of {len(learning)} trials are finished.",
            "`usbench compare`, run again, adds the rest.",
        ]
    trials = named(own.trials)
    learners = set(trials.loc[scores.ranked(trials), "agent"])
    reasons = {why for agent, why in scores.matrices(own)[1].items() if agent in learners}
    others = sorted(why for why in reasons if not why.startswith(scores.NOT_IN))
    why = " and ".join(others) or "the cells hold different agents"
    return [
        f"{OPEN}: no agent can be compared over all cells.",
        f"All trials ({len(learning)}) are finished, but {why}.",
    ]


def _short(learning: pd.DataFrame, agents: Collection[str]) -> list[str]:
    """Return in words on which tasks `agents` were trained with less than the budget."""
    own = named(learning)
    least = own[own["agent"].isin(agents)].groupby("task")["steps"].min()
    cut = [
        f"{steps} of {row_of(task).steps} steps on `{task}`"
        for task, steps in least.items()
        if steps < row_of(task).steps
    ]
    return [f"training was cut short ({', '.join(cut)})"] if cut else []


def _seen(learning: pd.DataFrame, agents: Collection[str]) -> list[str]:
    """Return in words which seeds of `agents` settings may have been chosen on."""
    own, pool = named(learning), seed_pools.own().comparison
    others = sorted({seed for seed in own.loc[own["agent"].isin(agents), "seed"] if seed not in pool})
    if not others:
        return []
    listed = ", ".join(map(str, others))
    are = "seed {} is" if len(others) == 1 else "seeds {} are"
    return [f"{are.format(listed)} not among those kept for comparisons ({pool})"]


def _is_part(cells: Sequence[scores.Cell], table: str) -> bool:
    """Return whether `cells` of a table are not the whole grid of the protocol."""
    return table != further.GRID or set(cells) < further.grid_cells()


def _where(cells: Sequence[scores.Cell], table: str) -> str:
    """Return in words over which cells of a table scores are."""
    listed = "; ".join(cell.name for cell in cells)
    if table != further.GRID:
        return (
            f"{len(cells)} {'cell' if len(cells) == 1 else 'cells'} of the further table {table} ({listed})"
        )
    if _is_part(cells, table):
        return f"{len(cells)} of the {len(further.grid_cells())} cells of the protocol ({listed})"
    return "the only cell" if len(cells) == 1 else f"{len(cells)} cells"


def _few(waiting: dict[str, int]) -> str:
    """Return in words how many seeds agents have that have too few."""
    low, high = min(waiting.values()), max(waiting.values())
    number = f"{low}" if low == high else f"{low} to {high}"
    return f"only {number} {'seed' if high == 1 else 'seeds'}, where at least {ranking.MIN_SEEDS} are needed"


def _first_look(table: pd.DataFrame, reasons: list[str], where: str) -> list[str]:
    ranked = _Ranked(table, set(), pd.DataFrame())
    best = str(table.index[0])
    near = list(table.index[table["score_high"] >= table["score_low"].iloc[0]].drop(best, errors="ignore"))
    sentences = [
        f"a first look and no ranking: {', and '.join(reasons)}.",
        f"{code(best)} has the highest score: {ranked.score(best)} over {where}, {SCALE}.",
    ]
    if near:
        sentences.append(f"its interval overlaps {'that' if len(near) == 1 else 'those'} of {names(near)}.")
    if PAPERS_OWN in table.index and best != PAPERS_OWN:
        sentences.append(
            f"`{PAPERS_OWN}`, the paper's vanilla policy gradient, has {ranked.score(PAPERS_OWN)}."
        )
    return [*sentences, f"{OPEN}."]


def _highest(ranked: _Ranked, where: str, waiting: Collection[str]) -> list[str]:
    best, *others = (str(agent) for agent in ranked.table.index)
    seeds = int(ranked.table.loc[best, "seeds"])
    score = f"{ranked.score(best)} over {where} with {seeds} seeds, {SCALE}"
    if not others:
        return [f"only {code(best)} has enough finished trials in every cell.", f"it has {score}."]
    among = f" of those with at least {ranking.MIN_SEEDS} seeds" if waiting else ""
    near = [one for one in others if not {(one, best), (best, one)} & ranked.above]
    return [
        f"{code(best)} has the highest score{among}: {score}.",
        *(f"{code(one)} has {ranked.score(one)} and cannot be told apart from {code(best)}." for one in near),
        *ranked.beside([one for one in others if one not in near], best),
    ]


def _against_the_papers_own(ranked: _Ranked, in_part: bool) -> list[list[str]]:
    agents = [str(agent) for agent in ranked.table.index]
    if PAPERS_OWN not in agents:
        return [[f"{OPEN}: `{PAPERS_OWN}` lacks finished trials in some cell, or seeds."]]
    # The same method with other settings is not another method.
    own = (PAPERS_OWN, PAPERS_OWN_TUNED)
    others = [agent for agent in agents if network_apart(agent.split()[0])[0] not in own]
    if not others:
        return [[f"{OPEN}: no other has enough finished trials in every cell."]]
    there = "there, " if in_part else ""
    if any((one, PAPERS_OWN) in ranked.above for one in others):
        verdict = f"{there}{BETTER}, `{PAPERS_OWN}`."
    elif all((PAPERS_OWN, one) in ranked.above for one in others):
        verdict = f"{there}{NONE_BETTER}, `{PAPERS_OWN}`."
    else:
        verdict = f"whether {BETTER}, `{PAPERS_OWN}`, cannot be told from these seeds."
    pair = ranked.pairs.set_index(["agent", "other"]).loc[(others[0], PAPERS_OWN)]
    chance = interval(pair["probability"], pair["sure_low"], pair["sure_high"], 2)
    n_pairs = len(ranked.pairs) // 2
    level = f"{100 * ranking.corrected_level(len(agents)):.4g} % interval"
    level += f", corrected for {n_pairs} pairs" if n_pairs > 1 else ""
    paragraphs = [
        [
            verdict,
            f"`{PAPERS_OWN}` has {ranked.score(PAPERS_OWN)}.",
            *ranked.beside(others, PAPERS_OWN),
            f"a trial of {code(others[0])} beats one of `{PAPERS_OWN}` with probability {chance} ({level}).",
        ]
    ]
    if PAPERS_OWN_TUNED in agents:
        paragraphs.append(
            [
                f"`{PAPERS_OWN_TUNED}` is the same algorithm, of which all settings were searched.",
                f"it has {ranked.score(PAPERS_OWN_TUNED)}.",
                *ranked.beside([PAPERS_OWN_TUNED], PAPERS_OWN),
                *ranked.beside(others, PAPERS_OWN_TUNED),
            ]
        )
    return paragraphs


def _phantoms(own: Results, tested: pd.DataFrame | None) -> list[list[str]]:
    """Return a paragraph on the phantom of the paper's tasks, and on scores on unseen phantoms."""
    tasks = [task for task in PAPER if task in set(own.trials["task"])]
    if not tasks:
        return []
    here = f"{names(tasks)} {'are' if len(tasks) > 1 else 'is'} evaluated on the phantom of training."
    if tested is None or (known := held_out.by_task(own, tested)).empty:
        return [[here, "how agents do on others is not tested here."]]
    trials = own.trials[own.trials["trial"].isin(tested["trial"])]
    several = (trials.groupby("task")["noise"].nunique() > 1).any()
    together = "; the tested noises are taken together" if several else ""
    sentences = [here, f"agents were tested on unseen phantoms, too{together}."]
    for task, rows in known.groupby("task"):
        sentences += [
            f"agents with {_range(rows['there'])} on `{task}`"
            f"{_where_tested(own.trials[own.trials['task'] == task], tested)} have "
            f"{_range(rows['elsewhere'])} on unseen phantoms.",
            *_ends(rows),
        ]
    return [sentences]


def _range(values: "pd.Series[float]") -> str:
    """Return in words between which scores agents lie."""
    return f"{number(values.min(), 2)} to {number(values.max(), 2)}"


def _ends(rows: pd.DataFrame) -> list[str]:
    """Return in a sentence which agents have the lowest and which the highest scores on unseen phantoms.

    All agents are named whose intervals overlap that of the lowest or of the highest; nobody is, where one
    overlaps both, or where no score is above that of the random agent.
    """
    if rows["elsewhere"].max() <= 0:
        return ["no score there is above that of the random agent."]
    if len(rows) < 2 or rows["low"].isna().any():
        return []
    lowest, highest = (rows.loc[place] for place in (rows["elsewhere"].idxmin(), rows["elsewhere"].idxmax()))
    low = list(rows.loc[rows["low"] <= lowest["high"], "agent"])
    high = list(rows.loc[rows["high"] >= highest["low"], "agent"])
    if {*low} & {*high}:
        return ["their intervals there overlap."]
    return [f"as far as intervals tell, the lowest there {_are(low)}, and the highest {_are(high)}."]


def _are(agents: Sequence[str]) -> str:
    return f"{'is' if len(agents) == 1 else 'are'} {names(agents)}"


def _where_tested(trials: pd.DataFrame, tested: pd.DataFrame) -> str:
    """Return in words at which noises a task's agents were tested on unseen phantoms; empty for all."""
    learned = trials[trials["steps"] > 0]
    noises, all_noises = (
        sorted(set(rows["noise"])) for rows in (learned[learned["trial"].isin(tested["trial"])], learned)
    )
    return "" if noises == all_noises else f" (noise {', '.join(f'{noise:g}' for noise in noises)})"
