"""Studies with people: how they did alone and with advice, beside the agent that advised and the optimum.

A study is a folder with `study.json` and `evaluations.jsonl`, whose lines have the format of a trial's
evaluations and besides `player`, and for people `advice`, `obeyed` and `seconds`, lists over the steps. The
first step after a start of the guide has no seconds: nobody knows when its page was opened.

All players of a study are compared over the same episodes: those that the person has played in both ways.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from usbench.anchors import Anchors
from usbench.atomic import atomic_file
from usbench.records import EVALUATIONS, ConfigurationError
from usbench.records.journal import UNREADABLE, read_rows, told
from usbench.results.text import number

STUDY, TABLE = "study.json", "studies.csv"
HUMAN, ADVISED, AGENT, OPTIMUM = "human", "human + advice", "agent", "optimum"
PLAYERS = (HUMAN, ADVISED, AGENT, OPTIMUM)
NUMBERS = ("return", "score", "success_rate", "obeyed", "seconds_per_step")
COLUMNS = (
    *("study", "task", "noise", "agent", "played", "plays", "player", "episodes"),
    *NUMBERS,
)


def folder_of(runs: Path, name: str) -> Path:
    """Return the folder of a study in `runs`."""
    return runs / f"study-{name}"


def folders(runs: Path) -> list[Path]:
    """Return the folders of the studies in `runs`, which may be one itself."""
    if (runs / STUDY).exists():
        return [runs]
    return sorted(path.parent for path in runs.glob(f"*/{STUDY}"))


def gather(runs: Path) -> pd.DataFrame:
    """Return a row for each study in `runs` and each of its players; `COLUMNS` are its columns.

    Raises:
        ConfigurationError: If the record of a study is damaged.
    """
    rows = [row for folder in folders(runs) for row in _rows(folder)]
    return pd.DataFrame(rows, columns=list(COLUMNS))


def write(known: pd.DataFrame, folder: Path) -> None:
    """Write the table beside those of a leaderboard; without a study there is none."""
    if known.empty:
        (folder / TABLE).unlink(missing_ok=True)
        return
    with atomic_file(folder / TABLE) as file:
        file.write(_as_csv(known).encode())


def add(known: pd.DataFrame, more: pd.DataFrame, *, replace: bool = False) -> pd.DataFrame:
    """Return the studies of both tables; of one that both have, that of `more`, which may have gone on.

    Raises:
        ConfigurationError: Unless `replace`, if a study of `known` has the name of one of `more`, which is
            another, or had been played further.
    """
    for name, now in more.groupby("study"):
        before = known[known["study"] == name]
        if not (replace or before.empty or _goes_on(before, now)):
            one = before.iloc[0]
            raise ConfigurationError(
                f"the tables have another study {name!r} ({one['task']}, noise {one['noise']:g}, advice by "
                f"{one['agent']}, {one['played']} of {one['plays']} played)."
            )
    kept = known[~known["study"].isin(more["study"])]
    return more if kept.empty else pd.concat([kept, more], ignore_index=True)


def _goes_on(before: pd.DataFrame, now: pd.DataFrame) -> bool:
    """Return whether the rows of a study are the same `now` as `before`, or of more episodes."""
    old, new = (_as_csv(rows[["task", "noise", "agent", "plays"]]) for rows in (before, now))
    more = now["played"].iloc[0] > before["played"].iloc[0]
    return old == new and (bool(more) or _as_csv(before) == _as_csv(now))


def _as_csv(known: pd.DataFrame) -> str:
    return str(known.round(6).to_csv(index=False, lineterminator="\n"))


def read(folder: Path) -> pd.DataFrame:
    """Return the table that `write` wrote, without rows if there is none.

    Raises:
        ValueError: If it lacks a column.
    """
    path = folder / TABLE
    if not path.is_file():
        return pd.DataFrame(columns=list(COLUMNS))
    # A study may have a name, such as NA, that pandas takes for a missing value.
    texts = ("study", "task", "agent", "player")
    empty = {name: [""] for name in NUMBERS}
    known = pd.read_csv(path, dtype=dict.fromkeys(texts, str), keep_default_na=False, na_values=empty)
    if missing := [name for name in COLUMNS if name not in known]:
        raise ValueError(f"{path} is damaged: it has no column {missing[0]!r}.")
    return known


def texts(known: pd.DataFrame) -> list[list[str]]:
    """Return the table in words, a row for each study and player."""
    return [
        [
            *(_name(row), str(row["task"]), f"{row['noise']:g}", str(row["player"])),
            *(str(row["episodes"]), number(row["return"], 2), number(row["score"], 2)),
            *(number(100 * row["success_rate"], 0), number(100 * row["obeyed"], 0)),
            number(row["seconds_per_step"], 1),
        ]
        for row in known.astype(dict.fromkeys(NUMBERS, float)).to_dict("records")
    ]


def _name(row: Mapping[str, Any]) -> str:
    """Return the name of a study, with what has been played of one that is not finished."""
    unfinished = row["played"] < row["plays"]
    return f"{row['study']} ({row['played']} of {row['plays']} played)" if unfinished else str(row["study"])


READING = (
    "Studies of `usbench guide --study`, a row for each player, over the same evaluation episodes, those "
    "that the person has played in both ways: people alone and with an agent's advice, the agent that "
    "advised (greedy), and the optimum, which knows the pose. The score is measured as everywhere here: 0 is "
    "a random agent, 1 the mean optimum."
)
HEAD = (
    *("study", "task", "noise", "player", "episodes", "return", "score", "success (%)"),
    *("advice obeyed (%)", "seconds per step"),
)


def damaged(path: Path, error: BaseException) -> ConfigurationError:
    """Return the error for a folder or file that is not the record of a study."""
    missing = "it has no " if isinstance(error, KeyError) else ""
    return ConfigurationError(f"{str(path)!r} is not the record of a study: {missing}{told(error)}.")


def _rows(folder: Path) -> list[dict[str, object]]:
    try:
        study = json.loads((folder / STUDY).read_text(encoding="utf-8"))
        anchors = Anchors(**study["anchors"])
        played = pd.DataFrame(read_rows(folder / EVALUATIONS))
        if played.empty:
            return []
        by_people = played[played["player"].isin((HUMAN, ADVISED))]
        study |= {"played": len(by_people), "plays": study.get("plays", len(by_people))}
        # Episodes differ in difficulty.
        ways = by_people.groupby("eval_episode")["player"].nunique()
        same = played[played["eval_episode"].isin(ways[ways == 2].index)]
        return [_row(study, anchors, player, same[same["player"] == player]) for player in PLAYERS]
    except (*UNREADABLE, KeyError, TypeError, AttributeError) as error:
        raise damaged(folder, error) from error


def _row(study: dict[str, object], anchors: Anchors, player: str, rows: pd.DataFrame) -> dict[str, object]:
    obeyed = [followed for own in rows["obeyed"] for followed in own] if player == ADVISED else []
    timed = rows["seconds"] if player in (HUMAN, ADVISED) else []
    seconds = [one for own in timed for one in own if one is not None]
    return {
        **{name: study[name] for name in ("study", "task", "noise", "agent", "played", "plays")},
        "player": player,
        "episodes": len(rows),
        "return": float(rows["return"].mean()),
        "score": float(anchors.score(rows["return"].mean())),
        "success_rate": float(rows["is_success"].mean()),
        "obeyed": sum(obeyed) / len(obeyed) if obeyed else None,
        "seconds_per_step": sum(seconds) / len(seconds) if seconds else None,
    }
