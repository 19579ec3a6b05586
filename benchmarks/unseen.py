"""What helps on unseen phantoms, how many phantoms it takes and how many steps: `make unseen`.

Trains `double_dqn` on `pp-tracked` with one thing changed at a time (ablations), on fixed sets of phantoms,
`distilled` beside it (the gap between known and unseen ones), and with more steps (scaling). Trials go into a
folder. The numbers of every finished trial are added to a CSV, from which tables are printed and figures are
drawn; what is finished in the folder, or stands in the CSV, is not trained again. Seeds are those for
development: no leaderboard takes these trials.
"""

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path

from rich.console import Console
from unseen_phantoms import drawing, trial_table
from unseen_phantoms.measuring import measured
from unseen_phantoms.studies import STUDIES, TASK, Study, Variant

from usbench import seed_pools, suite
from usbench.checks import unknown
from usbench.cli.output import sweep_output
from usbench.compare import plan, sweep
from usbench.compare.sweep import Outcome
from usbench.envs.threads import n_threads
from usbench.records import ConfigurationError, Trial, TrialConfig

DOCS = Path(__file__).parents[1] / "docs"


class AddingRows(sweep_output.SweepBars):
    """Progress that adds the numbers of each trial that ends to the CSV."""

    def __init__(self, add: Callable[[TrialConfig], None]) -> None:
        """Show progress as usual; `add` takes the configuration of each finished trial."""
        super().__init__()
        self._add = add

    def ended(self, outcome: Outcome) -> None:
        """A trial has ended."""
        super().ended(outcome)
        if outcome.reason is None:
            self._add(outcome.config)


def run(table: str, study: Study, out: Path, csv: Path, jobs: int) -> None:
    """Train what is missing of a table, `jobs` trials at a time, and add each trial to the CSV.

    All rows with the first seed are first.

    Raises:
        ConfigurationError: If a trial would end before an episode.
        RuntimeError: If a trial failed.
    """
    planned: dict[str, tuple[TrialConfig, Variant]] = {}
    known = recorded(csv)
    for seed, steps, variant in product(range(study.n_seeds), study.steps, study.variants):
        config = variant.config(steps, seed)
        _check_steps(config)
        if config.folder_name in known:
            row = known[config.folder_name]
            trial_table.add(csv, replace(row, table=table, variant=variant.title))
        else:
            planned[config.folder_name] = config, variant
    missing = set(planned)

    def add(config: TrialConfig) -> None:
        _, variant = planned[config.folder_name]
        trial_table.add(csv, measured(table, variant, Trial.read(out / config.folder_name)))
        missing.discard(config.folder_name)

    with AddingRows(add) as progress:
        outcomes = sweep.run([config for config, _ in planned.values()], out, progress, jobs=jobs)
    for outcome in outcomes:  # what was finished before
        if outcome.reason is None and outcome.config.folder_name in missing:
            add(outcome.config)
    if failed := sweep_output.failures(outcomes):
        raise RuntimeError("; ".join(failed))


def recorded(csv: Path) -> dict[str, trial_table.Row]:
    """Return the rows of a CSV by the names of their trials' folders; tables may share a trial."""
    found = {}
    for row in trial_table.rows(csv):
        for variant in STUDIES[row.table].variants if row.table in STUDIES else ():
            if (variant.title, variant.n_phantoms) == (row.variant, row.phantoms):
                found[variant.config(row.steps, row.seed).folder_name] = row
    return found


def _check_steps(config: TrialConfig) -> None:
    """Raise ConfigurationError unless episodes end in the trial: their phantoms are the known ones."""
    least = config.n_envs * suite.TASKS[config.task].n_steps
    if config.steps < least:
        raise ConfigurationError(
            f"steps must be at least {least}, an episode in each of {config.n_envs} environments, not "
            f"{config.steps}."
        )


def show(table: str, study: Study, csv: Path) -> None:
    """Print a table from the CSV, variants in the order of the study; those of earlier versions are last."""
    rows = trial_table.read(csv)
    places = {variant.title: place for place, variant in enumerate(study.variants)}
    own = rows[rows["table"] == table]
    own = own.assign(place=own["variant"].map(places)).sort_values(["place", *trial_table.KEY])
    Console(width=130).print(trial_table.printed(own, f"{TASK}: {table}"))


def main() -> None:
    """Train what is missing and print the tables that are asked for, or draw the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tables", nargs="+", choices=STUDIES, default=list(STUDIES))
    parser.add_argument("--rows", nargs="+", metavar="ROW", help="rows of the tables (by default all)")
    parser.add_argument("--steps", type=int, nargs="+", help="training steps (by default the table's own)")
    parser.add_argument("--seeds", type=int, help="development seeds per row (by default the table's own)")
    parser.add_argument("--jobs", type=int, default=n_threads(), help="trials at a time (default all cores)")
    parser.add_argument("--out", type=Path, default=Path("runs"), help="folder of trials (default runs)")
    parser.add_argument("--csv", type=Path, default=DOCS / "unseen.csv", help="the numbers of all trials")
    parser.add_argument(
        "--figures",
        type=Path,
        nargs="?",
        const=DOCS,
        help="train nothing, draw the figures from the CSV alone, into this folder (docs if none is named)",
    )
    args = parser.parse_args()
    if args.figures and not args.csv.exists():
        parser.error(f"there is no {args.csv}: train first, without --figures.")
    if args.figures:
        print(*drawing.write(trial_table.read(args.csv), args.figures), sep="\n")
        return
    try:
        _check_rows(args.tables, args.rows or ())
        for table in args.tables:
            study = asked(STUDIES[table], args.steps, args.seeds, args.rows)
            run(table, study, args.out, args.csv, plan.positive("jobs", args.jobs))
            show(table, study, args.csv)
    except KeyboardInterrupt:
        sys.exit("stopped: the same command goes on from here.")
    except ConfigurationError as error:
        parser.error(str(error))
    except RuntimeError as error:
        sys.exit(f"{error}; the same command tries again.")


def _check_rows(tables: Sequence[str], rows: Sequence[str]) -> None:
    """Raise ConfigurationError unless one of the tables has each of the rows."""
    titles = list(dict.fromkeys(one.title for table in tables for one in STUDIES[table].variants))
    for row in rows:
        if row not in titles:
            raise ConfigurationError(str(unknown("row", row, titles)))


def asked(
    study: Study, steps: Sequence[int] | None, n_seeds: int | None, rows: Sequence[str] | None
) -> Study:
    """Return a study with other steps or seeds, or with some of its rows, where they are not None.

    Raises:
        ConfigurationError: If a value is not allowed.
    """
    if rows is not None:
        study = replace(study, variants=tuple(one for one in study.variants if one.title in rows))
    if steps is not None:
        study = replace(study, steps=tuple(plan.positive("steps", own) for own in steps))
    if n_seeds is not None:
        study = replace(study, n_seeds=plan.positive("seeds", n_seeds))
    for seed in range(study.n_seeds):
        seed_pools.own().check("development", seed)
    return study


if __name__ == "__main__":
    main()
