"""The numbers of all trials as a small CSV, a row for each: tables are printed and figures drawn from it."""

from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np
import pandas as pd
from rich.table import Table

from usbench.atomic import atomic_file
from usbench.records.lock import locked
from usbench.results import scores


@dataclass(frozen=True)
class Row:
    """A trial and its numbers.

    Attributes:
        table: The table that it is of.
        variant: The row of that table, an agent or what is changed of it.
        phantoms: How many training phantoms there are, None for a new one in every episode.
        steps: Training steps.
        seed: Seed of the trial.
        digest: Names the fixed set of training phantoms, "" where there is none.
        known: Greedy score on phantoms of the training.
        unseen: Greedy score on unseen phantoms.
        minutes: Of CPU time in training.
    """

    table: str
    variant: str
    phantoms: int | None
    steps: int
    seed: int
    digest: str
    known: float
    unseen: float
    minutes: float


COLUMNS = [one.name for one in fields(Row)]
# What says which trial it is; of two rows that agree in it the newer one stays.
KEY = COLUMNS[: COLUMNS.index("digest")]
# A row of a printed table, and a point of a figure.
GROUP = ["variant", "phantoms", "steps"]
TYPES = {"table": str, "variant": str, "phantoms": "Int64", "steps": int, "seed": int, "digest": str}
DECIMALS = {"known": 4, "unseen": 4, "minutes": 1}


def read(path: Path) -> pd.DataFrame:
    """Return the rows in a CSV, none where there is no file; missing `phantoms` stand for no limit.

    Raises:
        ValueError: If the file has other columns.
    """
    if not path.exists():
        return pd.DataFrame(columns=COLUMNS).astype(TYPES | dict.fromkeys(DECIMALS, float))
    rows = pd.read_csv(path, dtype=TYPES, keep_default_na=False, na_values={"phantoms": [""]})
    if list(rows.columns) != COLUMNS:
        raise ValueError(f"{path} must have the columns {', '.join(COLUMNS)}, not {', '.join(rows.columns)}.")
    return rows


def rows(path: Path) -> list[Row]:
    """Return what `read` does as rows."""
    found = read(path).astype({"phantoms": object}).to_dict("records")
    return [
        Row(**one | {"phantoms": None if pd.isna(one["phantoms"]) else int(one["phantoms"])}) for one in found
    ]


def add(path: Path, row: Row) -> None:
    """Add a row to the CSV, which is made if need be; a row of the same trial is replaced.

    The file is read again each time: what another process has added stays.
    """
    new = pd.DataFrame([asdict(row)]).astype(TYPES).round(DECIMALS)
    with locked(path):
        known = read(path)
        rows = new if known.empty else pd.concat([known, new])
        rows = rows.drop_duplicates(KEY, keep="last").sort_values(KEY)
        with atomic_file(path) as file:
            rows.to_csv(file, index=False, lineterminator="\n")


def intervals(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the IQM over seeds of `known` and `unseen`, with 95 % bootstrap intervals, a row per `GROUP`.

    The columns are those of `GROUP`, `seeds`, `digest`, the mean of `minutes`, and for both scores the name
    and the name with `_low` and `_high`, NaN for a single seed. Variants keep the order of `rows`.
    """
    found = []
    for group, own in rows.groupby(GROUP, sort=False, dropna=False):
        of_both = {}
        for name in ("known", "unseen"):
            interval = scores.score_of(own[[name]].to_numpy(np.float64))
            of_both |= {column.replace("score", name): value for column, value in interval.items()}
        numbers = {"seeds": len(own), "digest": own["digest"].iloc[0], "minutes": own["minutes"].mean()}
        found.append(dict(zip(GROUP, group, strict=True)) | numbers | of_both)
    return pd.DataFrame(found).astype({"phantoms": "Int64"})


def printed(rows: pd.DataFrame, title: str) -> Table:
    """Return the rows of one table over seeds, as a table for the terminal."""
    table = Table(
        *("variant", "training phantoms", "steps", "seeds", "known", "unseen", "CPU minutes"), title=title
    )
    for one in intervals(rows).to_dict("records"):
        limited = "no limit" if pd.isna(one["phantoms"]) else f"{one['phantoms']} (set {one['digest']})"
        told = [_shown(one, name) for name in ("known", "unseen")]
        table.add_row(
            one["variant"], limited, str(one["steps"]), str(one["seeds"]), *told, f"{one['minutes']:.0f}"
        )
    return table


def _shown(one: dict[str, float], name: str) -> str:
    """Return a score with two digits, and its interval where there is one."""
    low, high = one[f"{name}_low"], one[f"{name}_high"]
    return f"{one[name]:.2f}" + ("" if np.isnan(low) else f" [{low:.2f}, {high:.2f}]")
