"""How hard each row is to tune: the scores of the candidates that a search drew at random.

Of the first rung alone, in which every candidate was trained; what survived it says nothing of the others.
"""

from itertools import product
from math import comb
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from usbench import seed_pools
from usbench.atomic import atomic_file
from usbench.checks import ConfigurationError
from usbench.records.journal import read_rows
from usbench.results import stats
from usbench.results.text import DASH, code, in_a_row, interval, names, number, table
from usbench.words import in_one_line

TABLE = "tuning.csv"
ABOUT = "What a search finds with few candidates: their scores in its first rung, and the best of n."
# `score` is empty where the training diverged; the first rung is 0, and the whole budget has the last.
COLUMNS = ("row", "candidate", "task", "noise", "seed", "score", "rung")
# Which trial of a record one is.
PLACE = ("rung", "candidate", "task", "noise", "seed")
SHOWN = (1, 2, 4, 8, 16)
# Intervals of the best of more hold the truth far too seldom (benchmarks/intervals.py).
LAST_WITH_INTERVAL = 4
# A candidate that diverged in any cell: what a random agent scores.
DIVERGED = 0.0


def gather(search: Path) -> pd.DataFrame:
    """Return the trials in the records of a folder, `COLUMNS`, of rows that have all of the first rung.

    Those of the finalists are there where all of them are finished.

    Raises:
        ConfigurationError: If there is no record, or one is damaged.
    """
    paths = sorted(search.glob("*.jsonl"))
    if not paths:
        raise ConfigurationError(
            f"there is no record of a search in {str(search)!r}: usbench search makes some."
        )
    found = [row for path in paths for row in _trials(path)]
    return pd.DataFrame(found, columns=list(COLUMNS)).sort_values(list(COLUMNS[:5]), ignore_index=True)


def write(known: pd.DataFrame, folder: Path) -> None:
    """Write the table beside those of a leaderboard."""
    with atomic_file(folder / TABLE) as file:
        file.write(known.to_csv(index=False, lineterminator="\n").encode())


def read(folder: Path) -> pd.DataFrame:
    """Return the table that `write` wrote, without rows if there is none.

    Raises:
        ValueError: If the file holds something else.
    """
    path = folder / TABLE
    if not path.is_file():
        return pd.DataFrame(columns=list(COLUMNS))
    try:
        known = pd.read_csv(path)
        if "rung" not in known:
            known = known.assign(rung=0)  # tables before the finalists were kept
        known = known[list(COLUMNS)]
        return known.astype({"candidate": int, "noise": float, "seed": int, "score": float, "rung": int})
    except (KeyError, ValueError) as error:
        raise ValueError(f"{path} is not a table of a search: {in_one_line(error)}") from error


def candidates(known: pd.DataFrame) -> dict[str, stats.Array]:
    """Return the mean score of each candidate by row, `(n_candidates,)`, NaN where it diverged.

    The row whose best candidate has the highest score comes first.
    """
    means = _means(known, 0)
    found = {str(row): own.to_numpy(np.float64) for row, own in means.groupby("row")}
    return dict(sorted(found.items(), key=lambda item: (-expected_best(item[1])[-1], item[0])))


def winners(known: pd.DataFrame) -> dict[str, float]:
    """Return the mean score of each row's winner with the whole budget, of rows with all finalists."""
    best = _means(known, _last_rung()).dropna().groupby("row").max()
    return {str(row): float(score) for row, score in best.items()}


def _means(known: pd.DataFrame, rung: int) -> pd.Series:
    own = known[known["rung"] == rung]
    return own.groupby(["row", "candidate"])["score"].agg(lambda scores: scores.mean(skipna=False))


def expected_best(scores: stats.Array) -> stats.Array:
    """Return the expected best of n candidates drawn without replacement, for n = 1 to all, `(..., n)`.

    By order statistics: the k-th smallest of N is the best in C(k - 1, n - 1) of C(N, n) draws. Candidates
    that diverged count as `DIVERGED`.
    """
    ordered = np.sort(np.where(np.isnan(scores), DIVERGED, scores), axis=-1)
    n_all = ordered.shape[-1]
    best_of = [
        [comb(rank - 1, n - 1) / comb(n_all, n) for n in range(1, n_all + 1)] for rank in range(1, n_all + 1)
    ]
    return np.asarray(ordered @ np.array(best_of))


def expected(scores: stats.Array) -> stats.Interval:
    """Return `expected_best` with its 95 % interval, which is NaN beyond `LAST_WITH_INTERVAL` candidates."""
    best = resampled(scores)
    best.low[LAST_WITH_INTERVAL:] = best.high[LAST_WITH_INTERVAL:] = np.nan
    return best


def resampled(scores: stats.Array) -> stats.Interval:
    """Return `expected_best` with its 95 % interval, whole candidates resampled.

    No resample has a better candidate than the best: towards all candidates, the upper end comes down to the
    estimate.
    """
    generator = np.random.default_rng(stats.BOOTSTRAP_SEED)
    drawn = generator.integers(len(scores), size=(stats.N_RESAMPLES, len(scores)))
    return stats.percentiles(expected_best(scores), expected_best(scores[drawn]))


def section(known: pd.DataFrame) -> str:
    """Return the section of the leaderboard, as Markdown."""
    by_row = candidates(known)
    at_last = winners(known)
    missing = [row for row in _search()["rows"] if row not in by_row]
    waiting = f" Not here, as that rung is not complete yet: {names(missing)}." if missing else ""
    head = [
        "row",
        "candidates",
        "diverged",
        "quartiles (least to most)",
        *(f"best of {n}" for n in SHOWN),
        "winner, whole budget",
    ]
    return (
        "Scores of the candidates that the search drew at random for each row, in its first rung: "
        f"{_first_rung()}. "
        "The expected best of n is that of n candidates drawn without replacement; up to n = "
        f"{LAST_WITH_INTERVAL} with a 95 % interval from candidates resampled, since no resample has a "
        "better candidate than the best one, and intervals for more hold the truth far too seldom "
        "(docs/comparison.md). It is the score by which candidates are chosen, so that other seeds will have "
        "less. In this table candidates that diverged count as 0; the search never chooses them."
        f"{waiting} The last column is the winner's mean score in "
        "the last rung, with the whole budget and other seeds: a row that is much better there learns "
        "slowly, and that alone makes its candidates look hard to tune.\n\n"
        + table(
            head,
            [[*_words(row, scores), number(at_last.get(row, np.nan), 2)] for row, scores in by_row.items()],
        )
    )


def _words(row: str, scores: stats.Array) -> list[str]:
    """Return the row of the table."""
    diverged = np.isnan(scores)
    ends = np.percentile(np.where(diverged, DIVERGED, scores), [0, 25, 50, 75, 100])
    best = expected(scores)
    return [
        code(str(row)),
        str(len(scores)),
        str(diverged.sum()),
        " / ".join(number(each, 2) for each in ends),
        *(
            DASH if n > len(scores) else interval(best.estimate[n - 1], best.low[n - 1], best.high[n - 1], 2)
            for n in SHOWN
        ),
    ]


def _trials(path: Path) -> list[dict[str, Any]]:
    """Return the trials of a record's first rung, none if some are missing, and of its complete last."""
    try:
        head, *trials = read_rows(path) or [{}]
        if head["protocol"] != seed_pools.digest(seed_pools.protocol()):
            raise ConfigurationError(f"{str(path)!r} is the record of a search by another protocol.")
        # Each place once: two searches at the same time may have recorded a trial twice.
        by_place = {tuple(one[name] for name in PLACE): one for one in trials}
        known = [
            {"row": head["row"], **{name: one[name] for name in COLUMNS[1:]}} for one in by_place.values()
        ]
        rung = _last_rung()
        first, last = ([one for one in known if one["rung"] == number] for number in (0, rung))
        if not _complete(first, 0, len(head["candidates"])):
            return []
        return [*first, *(last if _complete(last, rung, _search()["rungs"][rung - 1]["keep"]) else [])]
    except ConfigurationError:
        raise
    except (KeyError, TypeError, ValueError) as error:
        why = f"it has no {error}" if isinstance(error, KeyError) else error
        raise ConfigurationError(f"{str(path)!r} is not the record of a search: {why}.") from error


def _complete(found: list[dict[str, Any]], rung: int, n_candidates: int) -> bool:
    """Return whether `n_candidates` candidates have all trials of a rung."""
    search = _search()
    cells = product(search["tasks"], search["noises"], search["rungs"][rung]["seeds"])
    done = {tuple(one[name] for name in COLUMNS[1:5]) for one in found}
    tried = {one["candidate"] for one in found}
    return len(tried) >= n_candidates and done >= {(one, *cell) for cell in cells for one in tried}


def _search() -> dict[str, Any]:
    return dict(seed_pools.protocol()["search"])


def _first_rung() -> str:
    """Return in words of what the scores of the first rung are the mean."""
    search = _search()
    rung = search["rungs"][0]
    noises = in_a_row([f"{noise:g}" for noise in search["noises"]])
    seeds = in_a_row([str(seed) for seed in rung["seeds"]])
    return f"{rung['steps']} steps, the mean over {names(search['tasks'])}, noise {noises}, seed {seeds}"


def _last_rung() -> int:
    return len(_search()["rungs"]) - 1
