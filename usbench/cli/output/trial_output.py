"""What a person sees in the terminal: progress while a trial runs, a table and paths when it has ended."""

import sys
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table
from tqdm import tqdm

from usbench import records
from usbench.records import Trial, TrialConfig
from usbench.tasks import row_of

REFERENCES = ("random", "optimal")
# Title, mean of the episodes, format.
COLUMNS = (
    ("return", "return", "{:.2f}"),
    ("normalised\nscore", "normalized_score", "{:.2f}"),
    ("final\ndistance", "final_distance_mm", "{:.1f} mm"),
    ("plane\nerror", "plane_error_deg", "{:.1f} deg"),
    ("success\nrate", "success_rate", "{:.0%}"),
)


class Bars:
    """Progress on stderr: bars in a terminal, a line now and then in a file or a pipe.

    A `usbench.trials.callback.Progress`.
    """

    def __init__(self) -> None:
        """Draw nothing yet."""
        self._live = sys.stderr.isatty()
        self._bar: Any = None
        self._name = ""
        self._quarter = 0

    def frames(self, done: int, total: int) -> None:
        """`done` of `total` frames are simulated."""
        if self._live:
            self._show("simulating frames", done, total, "frame")
        elif total and 4 * done // total > self._quarter:
            self._quarter = 4 * done // total
            print(f"simulating frames: {done} of {total}", file=sys.stderr, flush=True)

    def training(self, step: int, steps: int, mean_return: float, score: float) -> None:
        """Training is at `step` of `steps`; mean return and normalised score of the last episodes."""
        if self._live:
            self._show("training", step, steps, "step", f"return {mean_return:.2f}, score {score:.2f}")

    def evaluated(self, step: int, mean_return: float, score: float) -> None:
        """The agent was evaluated at `step`; mean return and score of its sampled actions."""
        line = f"step {step}: evaluation return {mean_return:.2f}, normalised score {score:.2f}"
        if self._live:
            tqdm.write(line, file=sys.stderr)
        else:
            print(line, file=sys.stderr, flush=True)

    def stopping(self) -> None:
        """Somebody has asked for the end, which comes before the next rollout."""
        print("stopping before the next rollout; Ctrl-C again stops at once", file=sys.stderr, flush=True)

    def close(self) -> None:
        """Leave the last bar as it stands."""
        if self._bar is not None:
            self._bar.close()

    def _show(self, name: str, done: int, total: int, unit: str, postfix: str = "") -> None:
        if name != self._name:
            self.close()
            self._bar = tqdm(total=total, desc=name, unit=unit, file=sys.stderr, dynamic_ncols=True)
            self._name = name
        self._bar.set_postfix_str(postfix, refresh=False)
        self._bar.update(done - self._bar.n)


def trial_table(folder: Path) -> Table:
    """Return the last evaluation of a trial as a table, beside the random agent and the optimum."""
    trial = Trial.read(folder)
    config, anchors = trial.config, trial.anchors
    table = Table(
        title=trial.title,
        caption=f"Means of {trial.n_evaluation_episodes} evaluation episodes after {config.steps} "
        "training steps. The returns of random and optimal are exact expectations.",
    )
    table.add_column("agent", no_wrap=True)
    silent = row_of(config.task).silent
    columns = [column for column in COLUMNS if column[1] not in silent]
    for title, *_ in columns:
        table.add_column(title, justify="right", no_wrap=True)
    shown = {
        f"{config.algo}, sampled": records.means(trial.last_evaluation(deterministic=False)),
        f"{config.algo}, greedy": records.means(trial.last_evaluation(deterministic=True)),
        **{name: {**trial.references[name], "return": getattr(anchors, name)} for name in REFERENCES},
    }
    for name, means in shown.items():
        values = {**means, "normalized_score": anchors.score(means["return"])}
        table.add_row(name, *(form.format(values[key]) for _, key, form in columns))
    return table


def print_trial(folder: Path, figures: dict[str, Path]) -> None:
    """Print the table of a finished trial and where its files are."""
    Console().print(trial_table(folder))
    if unused := not_learned(Trial.read(folder).config):
        print(unused)
    # Plain prints: a path must not be wrapped.
    for name, path in {"trial folder": folder, **figures}.items():
        print(f"{name + ':':<16}{path}")


def not_learned(config: TrialConfig) -> str:
    """Return what a trial of so few steps did not learn from, in a sentence; "" if it learned from all."""
    steps, values = config.steps, config.hyperparameters
    rest = steps % values.get("n_steps", 1)
    if rest:
        return f"The last {rest} of {steps} steps were not learned from: an update takes {values['n_steps']}."
    if 0 < steps <= values.get("learning_starts", 0):
        return f"Nothing was learned in {steps} steps: learning starts after {values['learning_starts']}."
    return ""
