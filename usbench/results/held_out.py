"""The track of unseen phantoms: agents trained on one phantom and on many, and the gap between them."""

from collections.abc import Collection, Iterator, Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from usbench import records, tasks
from usbench.anchors import Anchors
from usbench.atomic import atomic_file
from usbench.records.lock import locked
from usbench.results import scores, stats, text
from usbench.results.agents import named
from usbench.results.protocol import further
from usbench.results.tables import DECIMALS, Results
from usbench.words import in_one_line

TABLE = "held_out.csv"
# Of a trial on one phantom: the task on many, and means over its evaluation episodes, greedy actions.
COLUMNS = ("trial", "task", "episodes", "normalized_score", "return", "success_rate")
KEYS = ["noise", "task", "agent"]
# The task with new phantoms in every episode, by the same task on one.
MANY = {row.single: name for name, row in tasks.rows().items() if row.single}


def read(folder: Path) -> pd.DataFrame:
    """Read what `write` wrote; no rows where there is no such file.

    Raises:
        ValueError: If the file holds something else.
    """
    path = folder / TABLE
    if not path.exists():
        return pd.DataFrame(columns=list(COLUMNS))
    try:
        table = pd.read_csv(path)[list(COLUMNS)]
        return table.astype({"episodes": int, **dict.fromkeys(COLUMNS[3:], float)})
    except (KeyError, ValueError) as error:
        raise ValueError(f"{path} is not a table of tests: {in_one_line(error)}") from error


def write(tested: pd.DataFrame, folder: Path) -> None:
    """Write the tests into `folder`."""
    rows = tested.sort_values("trial").round(DECIMALS).to_csv(index=False, lineterminator="\n")
    with atomic_file(folder / TABLE) as file:
        file.write(rows.encode())


def forget(folder: Path, trials: Collection[str]) -> list[str]:
    """Remove the tests of some trials from the file in `folder`, and return the names that it had."""
    if not trials:
        return []
    with locked(folder / TABLE):
        tested = read(folder)
        gone = tested["trial"].isin(trials)
        if gone.any():
            write(tested[~gone], folder)
        return list(tested.loc[gone, "trial"])


def keep(folder: Path, trials: Collection[str]) -> None:
    """Remove the tests of all other trials from the file in `folder`."""
    with locked(folder / TABLE):
        tested = read(folder)
        write(tested[tested["trial"].isin(trials)], folder)


def add(row: Mapping[str, object], folder: Path) -> None:
    """Add a test, `COLUMNS`, to those in `folder`, in place of one of the same trial."""
    with locked(folder / TABLE):
        tested = read(folder)
        others = tested[tested["trial"] != row["trial"]].to_dict("records")
        write(pd.DataFrame([*others, row], columns=list(COLUMNS)), folder)


def candidates(known: Results) -> pd.DataFrame:
    """Return the finished trials of the grid on one phantom that have a counterpart with many."""
    trials = further.first(known).trials
    return trials[(trials["status"] == "finished") & trials["task"].isin(MANY) & (trials["steps"] > 0)]


def _scored(known: Results) -> pd.DataFrame:
    """Return the finished trials of agents that learn, with their final score and the row of each."""
    last = scores.last(known)[["trial", "normalized_score"]]
    return named(known.trials[known.trials["steps"] > 0]).merge(last, on="trial")


def table(known: Results, tested: pd.DataFrame) -> pd.DataFrame:
    """Return a row per noise, task (on many phantoms) and agent: a configuration where a cell has several.

    Columns: `seen`, `one` and `many`, each with `_low`, `_high` (95 % interval) and `_seeds`: the score of
    agents trained on one phantom, on that phantom and on unseen ones, and of agents trained on many phantoms,
    on the same unseen ones; and `gap`, `many` less `one`. NaN where nothing was tested.
    """
    own = _scored(known)
    elsewhere = own.drop(columns=["task", "normalized_score"]).merge(tested, on="trial")
    parts = {
        "seen": own[own["trial"].isin(elsewhere["trial"])].assign(task=lambda rows: rows["task"].map(MANY)),
        "one": elsewhere,
        "many": own[own["task"].isin(MANY.values())],
    }
    return pd.DataFrame(_rows(parts), columns=[*KEYS, *_columns(parts), "gap"])


def not_tested(known: Results, tested: pd.DataFrame) -> list[scores.Cell]:
    """Return the cells with agents that learned on one phantom, none of which was tested elsewhere."""
    own = known.trials[(known.trials["steps"] > 0) & known.trials["task"].isin(MANY)]
    there = scores.cells_of(own[own["trial"].isin(tested["trial"])])
    return [cell for cell in scores.cells_of(own) if cell not in there]


def by_task(known: Results, tested: pd.DataFrame) -> pd.DataFrame:
    """Return a row per task on one phantom and agent: its IQM `there`, and `elsewhere` on unseen phantoms.

    It is over all noises and seeds that were tested. `low` and `high` are the 95 % interval of `elsewhere`,
    with trials resampled over all noises together; a single trial has none.
    """
    own = _scored(known)
    both = own.merge(tested[["trial", "normalized_score"]], on="trial", suffixes=("", "_elsewhere"))
    rows = [
        {
            **dict(zip(("task", "agent"), key, strict=True)),
            "there": float(stats.iqm(rows[["normalized_score"]])),
            **dict(
                zip(
                    ("elsewhere", "low", "high"),
                    scores.score_of(rows[["normalized_score_elsewhere"]].to_numpy(np.float64)).values(),
                    strict=True,
                )
            ),
        }
        for key, rows in both.groupby(["task", "agent"])
    ]
    return pd.DataFrame(rows, columns=["task", "agent", "there", "elsewhere", "low", "high"])


def _columns(parts: dict[str, pd.DataFrame]) -> list[str]:
    return [f"{part}{kind}" for part in parts for kind in ("", "_low", "_high", "_seeds")]


def _rows(parts: dict[str, pd.DataFrame]) -> Iterator[dict[str, object]]:
    # What was trained on many phantoms alone, or never tested, is in the other tables.
    for key in sorted(set(parts["one"][KEYS].itertuples(index=False, name=None))):
        row: dict[str, object] = dict(zip(KEYS, key, strict=True))
        for part, rows in parts.items():
            matrix = rows[rows[KEYS].eq(pd.Series(key, index=KEYS)).all(axis=1)][
                ["normalized_score"]
            ].to_numpy(np.float64)
            score, low, high = scores.score_of(matrix).values() if len(matrix) else (np.nan,) * 3
            row |= {part: score, f"{part}_low": low, f"{part}_high": high, f"{part}_seeds": len(matrix)}
        yield row | {"gap": row["many"] - row["one"]}  # type: ignore[operator]


def summary(trial: str, task: str, evaluations: pd.DataFrame, anchors: Anchors) -> dict[str, object]:
    """Return the row of a trial from the evaluation episodes that it played on `task`."""
    means = records.means(evaluations)
    score = anchors.score(means["return"])
    row = {"trial": trial, "task": task, "episodes": len(evaluations), "normalized_score": score, **means}
    return {name: row[name] for name in COLUMNS}


def section(known: pd.DataFrame) -> str:
    """Return the section of the leaderboard from what `table` gives, as Markdown.

    Columns on agents that were trained on many phantoms are there only where there are such agents.
    """
    trained_on_many = known["many"].notna().any()
    head = ["agent", "phantoms of", "on its own phantom", "on unseen phantoms"]
    head += ["score trained on many", "gap", "seeds"] if trained_on_many else ["seeds"]
    lines = []
    for row in known.to_dict("records"):
        parts = ("seen", "one", "many") if trained_on_many else ("seen", "one")
        line = [text.agent(row["agent"]), scores.Cell(row["task"], row["noise"]).name]
        line += [text.interval(row[part], row[f"{part}_low"], row[f"{part}_high"]) for part in parts]
        seeds = str(row["one_seeds"])
        line += (
            [text.number(row["gap"], 3), f"{seeds} and {row['many_seeds']}"] if trained_on_many else [seeds]
        )
        lines.append(line)
    about = "Scores (IQM, greedy actions) of agents that learned on one phantom: on it, and on others."
    if trained_on_many:
        about += (
            " Score trained on many: of agents that learned on many phantoms, on the same unseen ones; gap: "
            "that score minus the one on unseen phantoms."
        )
    if "pp-random" in set(known["task"]):
        about += " `pp-random` has other starts than `pp`, too."
    return f"{about}\n\n" + text.folded(f"Scores ({text.rows(len(lines))})", text.table(head, lines, words=2))
