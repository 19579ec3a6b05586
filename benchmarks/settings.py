"""Which searched settings mattered: the rank correlation of each with the scores of the candidates.

Of the first rung of every search in a folder, in which all candidates are: Spearman's correlation over the
candidates, with the p-value of a permutation test. The candidates were drawn at random; where the space
ties settings together, as VPG's first value to its discount, one may stand for the other. Sixteen
candidates show strong effects only.
"""

import argparse
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy import stats

from usbench.records.journal import read_rows
from usbench.results.protocol import tuning

SEARCH = Path(__file__).parents[1] / "search"
# So many that chance does not decide on which side of the corrected level, 0.05 / 54, a p-value lies.
N_PERMUTATIONS, BATCH = 1_000_000, 20_000


def correlation(values: list[float], scores: list[float]) -> tuple[float, float]:
    """Return Spearman's rank correlation and its two-sided p-value, from permutations."""
    ranks, fixed = (stats.zscore(stats.rankdata(own)) for own in (values, scores))
    test = stats.permutation_test(
        (ranks,),
        lambda order, axis: (order * fixed).mean(axis),
        permutation_type="pairings",
        vectorized=True,
        n_resamples=N_PERMUTATIONS,
        batch=BATCH,
        rng=np.random.default_rng(0),
    )
    return float(test.statistic), float(test.pvalue)


def main() -> None:
    """Print a row per algorithm, its settings with the strongest correlation first."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--search", type=Path, default=SEARCH, help="folder of records (default search)")
    args = parser.parse_args()
    table = Table("row", "rank correlation with the score (p)", title="settings of the candidates")
    for row, scores in tuning.candidates(tuning.gather(args.search)).items():
        candidates = next(iter(read_rows(args.search / f"{row}.jsonl")))["candidates"]
        own = np.nan_to_num(scores, nan=tuning.DIVERGED).tolist()
        found = {name: correlation([float(each[name]) for each in candidates], own) for name in candidates[0]}
        ordered = sorted(found.items(), key=lambda item: -abs(item[1][0]))
        table.add_row(row, ", ".join(f"{name} {rho:+.2f} ({p:.4f})" for name, (rho, p) in ordered))
    Console(width=160).print(table)


if __name__ == "__main__":
    main()
