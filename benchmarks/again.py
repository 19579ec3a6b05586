"""Train trials of the leaderboard again: does another day give the same scores?

`python benchmarks/again.py --draw 20261125` draws trials of the protocol's grid at random (two, if `--trials`
does not say another number), trains them in `--out`, and prints both scores with greedy actions. Where the
processor is of the kind that trained the leaderboard's, they are the same to the last digit. Where it is not,
rounding takes training another way, as another seed does: how far that goes says the spread, the standard
deviation of the agent's scores over the seeds of the cell.
"""

import argparse
import sys
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from usbench.checks import whole_number
from usbench.cli.output import sweep_output
from usbench.compare import plan, protocol, sweep
from usbench.records import Trial, TrialConfig
from usbench.results import leaderboard, tables
from usbench.results.tables import GREEDY, Results

CELL = ["task", "noise", "configuration"]
COLUMNS = ("trial", "leaderboard", "again", "difference", "spread of the cell", "frames")


def drawn(known: Results, number: int, n_trials: int) -> list[TrialConfig]:
    """Return finished trials of the grid that learn, drawn by the generator with the seed `number`.

    Raises:
        ValueError: If `number` is negative, or there are not as many trials.
    """
    finished = set(known.trials.loc[known.trials["status"] == "finished", "trial"])
    planned = plan.by_protocol(protocol.read())
    there = [config for config in planned if config.steps and config.folder_name in finished]
    n_drawn = whole_number("trials", n_trials, 1, len(there))
    generator = np.random.default_rng(whole_number("draw", number, 0))
    return [there[i] for i in generator.choice(len(there), n_drawn, replace=False)]


def scores(known: Results, config: TrialConfig) -> tuple[float, float]:
    """Return a trial's score, and the standard deviation over the seeds of its cell."""
    trials = known.trials
    own = trials[trials["trial"] == config.folder_name].iloc[0]
    planned = {one.folder_name for one in plan.by_protocol(protocol.read())}
    alike = trials[(trials[CELL] == own[CELL]).all(axis=1) & trials["trial"].isin(planned)]
    curves = known.curves[(known.curves["kind"] == GREEDY) & known.curves["trial"].isin(alike["trial"])]
    last = curves.groupby("trial")["normalized_score"].last()
    return float(last[config.folder_name]), float(last.std(ddof=1))


def row(known: Results, config: TrialConfig, out: Path) -> tuple[str, ...]:
    """Return the line of a trial that was trained again."""
    trial = Trial.read(out / config.folder_name)
    before, spread = scores(known, config)
    now = float(trial.last_evaluation(deterministic=True)["normalized_score"].mean())
    frames = known.trials.set_index("trial").loc[config.folder_name, "frames"]
    same = trial.frames is not None and trial.frames.digest.startswith(frames)
    numbers = (f"{before:.5f}", f"{now:.5f}", f"{now - before:+.5f}", f"{spread:.3f}")
    return config.title, *numbers, "the same" if same else "another processor's"


def main() -> None:
    """Draw, train and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--draw", type=int, required=True, help="seed of the draw, for example today's date")
    parser.add_argument("--trials", type=int, default=2, help="how many (default 2)")
    parser.add_argument("--out", type=Path, default=Path("runs/again"), help="folder (default runs/again)")
    parser.add_argument("--jobs", type=int, default=1, help="trials that run at a time (default 1)")
    args = parser.parse_args()
    known = tables.read(leaderboard.files(Path("leaderboard.md")))
    try:
        chosen, jobs = drawn(known, args.draw, args.trials), plan.positive("jobs", args.jobs)
    except ValueError as error:
        parser.error(str(error))
    with sweep_output.SweepBars() as bars:
        outcomes = sweep.run(chosen, args.out, bars, jobs=jobs)
    shown = Table(*COLUMNS)
    finished = {outcome.config.folder_name for outcome in outcomes if outcome.reason is None}
    for config in (config for config in chosen if config.folder_name in finished):
        shown.add_row(*row(known, config, args.out))
    if shown.rows:
        Console(width=130).print(shown)
    if failed := sweep_output.failures(outcomes):
        sys.exit("; ".join(failed))


if __name__ == "__main__":
    main()
