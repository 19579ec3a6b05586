"""How often the leaderboard's intervals hold the truth, by simulation: `make coverage` (half an hour).

`--only tuning` is the table of the expected best of n candidates alone (seconds).

Scores of trials are drawn from distributions that are known, so that the interquartile mean of infinitely
many seeds is known too. Of many such comparisons the share is counted whose 95 % interval holds it; and, of
comparisons of agents that are all the same, the share in which any of them is said to lie above another.
The same is counted for the expected best of n candidates, of 16 that a search drew.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt
from rich.console import Console
from rich.progress import track
from rich.table import Table

from usbench.compare import plan, protocol
from usbench.results import ranking, scores, stats, tables
from usbench.results.protocol import tuning
from usbench.results.tables import Results

Array = npt.NDArray[np.float64]
Draw = Callable[[int, np.random.Generator], Array]

# All six cells of the grid, with ten seeds, from which it is seen how scores differ between seeds and cells;
# and the candidates of the search.
COMMITTED = Path(__file__).parents[1] / "leaderboard_files"
N_CELLS = 6
SEEDS = (3, 5, 10)
# Means of six cells, from easy to hard.
MEANS = np.array([0.99, 0.96, 0.93, 0.90, 0.86, 0.80])
# Of a row of the committed table, each score is spread by this share of its cell's standard deviation.
SPREAD = 0.5
N_AGENTS = 8
# Fewer than for the leaderboard: the ends of an interval are to be right on average only.
N_RESAMPLES = 10_000
TRUTH = 200_000
N_CANDIDATES = 16
# Of the scores of a row of candidates, each is spread by this share of their standard deviation.
ERROR = 0.15


def normal(n_seeds: int, generator: np.random.Generator) -> Array:
    """Return scores `(n_seeds, n_cells)` that are normal in every cell, independent."""
    return generator.normal(MEANS, 0.03, size=(n_seeds, N_CELLS))


def ceiling(n_seeds: int, generator: np.random.Generator) -> Array:
    """Return scores that miss 1 by an exponential amount, small in easy cells and large in hard ones."""
    return 1 - generator.exponential(1 - MEANS, size=(n_seeds, N_CELLS))


def collapsing(n_seeds: int, generator: np.random.Generator) -> Array:
    """Return normal scores, of which one in ten has collapsed to about 0.3."""
    fine = normal(n_seeds, generator)
    return np.where(generator.random(fine.shape) < 0.1, generator.normal(0.3, 0.1, fine.shape), fine)


def common(share: float) -> Draw:
    """Return a distribution of normal scores, with a share of the variance common to all cells of a seed."""

    def draw(n_seeds: int, generator: np.random.Generator) -> Array:
        seed, own = generator.normal(size=(n_seeds, 1)), generator.normal(size=(n_seeds, N_CELLS))
        return MEANS + 0.03 * (np.sqrt(share) * seed + np.sqrt(1 - share) * own)

    return draw


def grid() -> Results:
    """Return the committed trials of the protocol's grid, whatever else is in the tables."""
    known = tables.read(COMMITTED)
    names = [config.folder_name for config in plan.by_protocol(protocol.read())]
    return known.of(known.trials[known.trials["trial"].isin(names)])


def committed() -> dict[str, Draw]:
    """Return a distribution for each row of the committed table of the paper's tasks."""
    known = grid()
    return {f"as `{row}`": _like(matrix) for row, matrix in scores.learners(known).items() if len(matrix) > 1}


def _like(matrix: Array) -> Draw:
    """Return a distribution like a row: one of its scores in the cell, and a normal error; at most 1."""
    error = SPREAD * matrix.std(axis=0, ddof=1)

    def draw(n_seeds: int, generator: np.random.Generator) -> Array:
        shape = (n_seeds, matrix.shape[1])
        chosen = np.take_along_axis(matrix, generator.integers(len(matrix), size=shape), axis=0)
        return np.minimum(chosen + generator.normal(size=shape) * error, 1.0)

    return draw


DISTRIBUTIONS: dict[str, Draw] = {
    "normal": normal,
    "near the ceiling": ceiling,
    "one in ten collapsed": collapsing,
    "a sixth common to a seed": common(1 / 6),
    "half common to a seed": common(1 / 2),
}


def coverage(draw: Draw, n_seeds: int, n_simulations: int, whole_seeds: bool) -> float:
    """Return the share of simulations whose interval holds the IQM of infinitely many seeds."""
    generator = np.random.default_rng(n_seeds)
    truth = float(stats.iqm(draw(TRUTH, generator)))
    held = 0
    for _ in range(n_simulations):
        interval = stats.stratified_bootstrap(
            stats.iqm, draw(n_seeds, generator), generator=generator, whole_seeds=whole_seeds
        )
        held += bool(interval.low <= truth <= interval.high)
    return held / n_simulations


def false_alarms(draw: Draw, n_seeds: int, n_simulations: int, whole_seeds: bool) -> float:
    """Return the share of comparisons of equal agents in which one is said to lie above another."""
    generator = np.random.default_rng(n_seeds)
    level = ranking.corrected_level(N_AGENTS)
    counts = [stats.draw_counts(n_seeds, N_CELLS, N_RESAMPLES, generator, whole_seeds) for _ in range(2)]
    alarms = 0
    for _ in range(n_simulations):
        agents = [draw(n_seeds, generator) for _ in range(N_AGENTS)]
        alarms += any(
            _apart(agents[one], agents[other], counts, level)
            for one in range(N_AGENTS)
            for other in range(one)
        )
    return alarms / n_simulations


def _apart(x: Array, y: Array, counts: list[Array], level: float) -> bool:
    resampled = stats.resampled_improvement(x, y, *counts)
    interval = stats.percentiles(stats.probability_of_improvement(x, y), resampled, level)
    return bool(interval.low > 0.5 or interval.high < 0.5)


def best_of(draw: Draw, n_simulations: int) -> Array:
    """Return for each n of `tuning.SHOWN` the share of intervals of the expected best of n that hold it."""
    generator, at = np.random.default_rng(0), np.array(tuning.SHOWN)
    ordered = np.sort(draw(TRUTH, generator))
    ranks = np.arange(TRUTH + 1)[:, np.newaxis] / TRUTH
    truth = ordered @ np.diff(ranks**at, axis=0)
    held = np.zeros(len(at))
    for _ in range(n_simulations):
        best = tuning.resampled(draw(N_CANDIDATES, generator))
        held += (best.low[at - 1] <= truth) & (truth <= best.high[at - 1])
    return held / n_simulations


def candidates() -> dict[str, Draw]:
    """Return a distribution of candidates' scores like each row of the committed search, and a normal one."""
    found: dict[str, Draw] = {"normal": lambda n, generator: generator.normal(0.5, 0.2, n)}
    for row, own in tuning.candidates(tuning.read(COMMITTED)).items():
        found[f"as `{row}`"] = _smooth(own)
    return found


def _smooth(own: Array) -> Draw:
    """Return a distribution like the scores `own`: one of them, and a small normal error."""
    own = np.nan_to_num(own, nan=tuning.DIVERGED)
    error = ERROR * float(own.std(ddof=1))
    return lambda n, generator: generator.choice(own, n) + generator.normal(size=n) * error


def tuning_table(n_simulations: int) -> Table:
    """Return how often the interval of the expected best of n candidates holds the truth."""
    shown = Table(title=f"share of 95 % intervals of the best of n of {N_CANDIDATES} that hold the truth")
    shown.add_column("candidates")
    for n in tuning.SHOWN:
        shown.add_column(f"n = {n}", justify="right")
    for name, draw in candidates().items():
        shown.add_row(name, *(f"{100 * share:.1f} %" for share in best_of(draw, n_simulations)))
    return shown


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--simulations", type=int, default=600, help="simulations of each kind (default 600)")
    parser.add_argument("--families", type=int, default=200, help="comparisons of equal agents (default 200)")
    every = DISTRIBUTIONS | committed()
    parser.add_argument(
        "--scores", nargs="+", choices=every, default=list(every), help="only these distributions"
    )
    parser.add_argument("--only", choices=["tuning"], help="only the table of the best of n candidates")
    args = parser.parse_args()
    console = Console()
    console.print(tuning_table(args.simulations))
    if args.only:
        return
    every = {name: every[name] for name in args.scores}

    cover = Table(title=f"share of 95 % intervals of the IQM over {N_CELLS} cells that hold the truth")
    cover.add_column("scores")
    for n in SEEDS:
        cover.add_column(f"{n} seeds", justify="right")
        cover.add_column("whole", justify="right")
    for name, draw in track(every.items(), description="coverage", console=Console(stderr=True)):
        shares = [coverage(draw, n, args.simulations, whole) for n in SEEDS for whole in (False, True)]
        cover.add_row(name, *(f"{100 * share:.1f} %" for share in shares))
    console.print(cover)

    alarms = Table(title=f"share of comparisons of {N_AGENTS} equal agents in which one lies above another")
    alarms.add_column("scores")
    for n in SEEDS:
        alarms.add_column(f"{n} seeds", justify="right")
        alarms.add_column("whole", justify="right")
    equal = {name: draw for name, draw in every.items() if name in DISTRIBUTIONS}
    for name, draw in track(equal.items(), description="equal agents", console=Console(stderr=True)):
        shares = [false_alarms(draw, n, args.families, whole) for n in SEEDS for whole in (False, True)]
        alarms.add_row(name, *(f"{100 * share:.1f} %" for share in shares))
    console.print(alarms)


if __name__ == "__main__":
    main()
