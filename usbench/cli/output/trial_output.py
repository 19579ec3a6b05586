"""What a person sees in the terminal: progress while a trial runs, a table and paths when it has ended."""

import shlex
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table
from tqdm import tqdm

from usbench import records, suite
from usbench.agents import zoo
from usbench.records import Trial, TrialConfig
from usbench.tasks import row_of

REFERENCES = ("random", "optimal")


@dataclass(frozen=True)
class Column:
    """A column of the table: its title, the mean over episodes in it, its format, and what it means."""

    title: str
    mean: str
    form: str
    meaning: str


COLUMNS = (
    Column("return", "return", "{:.2f}", "sum of the rewards of an episode"),
    Column("normalised\nscore", "normalized_score", "{:.2f}", "0 is the random agent, 1 is the optimum"),
    Column("final\ndistance", "final_distance_mm", "{:.1f} mm", "from the last pose to the goal"),
    Column(
        "plane\nerror",
        "plane_error_deg",
        "{:.1f} deg",
        "angle between the last frame's plane and the object's, 0 to 90 degrees",
    ),
    Column("success\nrate", "success_rate", "{:.0%}", "share of the episodes whose last pose is the goal"),
)
# Characters: the numbers of all columns, and what is left for a name that is folded.
NARROWEST = 72


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
        # When the training began, at which step, and at which of how many steps it is.
        self._begun: tuple[float, int] | None = None
        self._now = (0, 0)

    def frames(self, done: int, total: int) -> None:
        """`done` of `total` frames are simulated."""
        if self._live:
            self._show("simulating frames", done, total, "frame")
        elif total and 4 * done // total > self._quarter:
            self._quarter = 4 * done // total
            print(f"simulating frames: {done} of {total}", file=sys.stderr, flush=True)

    def expected(self, wall_s: float, cpu_s: float) -> None:
        """Training and evaluations, which begin now, will take about so long, and so much of the cores."""
        told = (
            f"training and evaluations: {duration(wall_s)} as this machine is now ({duration(cpu_s)} of CPU "
        )
        print(f"{told}time), by a short rehearsal", file=sys.stderr, flush=True)

    def training(self, step: int, steps: int, mean_return: float, score: float) -> None:
        """Training is at `step` of `steps`; mean return and normalised score of the last episodes."""
        if self._begun is None:
            self._begun = time.monotonic(), step
        self._now = step, steps
        if self._live:
            self._show("training", step, steps, "step", f"return {mean_return:.2f}, score {score:.2f}")

    def evaluated(self, step: int, mean_return: float, score: float) -> None:
        """The agent was evaluated at `step`; mean return and score of its greedy actions."""
        line = (
            f"step {step}: evaluation return {mean_return:.2f}, normalised score {score:.2f}{self._to_go()}"
        )
        if self._live:
            tqdm.write(line, file=sys.stderr)
        else:
            print(line, file=sys.stderr, flush=True)

    def _to_go(self) -> str:
        """Return in words how long the training goes on, as it went so far; empty where nobody knows."""
        step, steps = self._now
        if self._begun is None or step <= self._begun[1] or step >= steps:
            return ""
        each = (time.monotonic() - self._begun[0]) / (step - self._begun[1])
        return f", {duration(each * (steps - step))} to go"

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
    """Return the last evaluation of a trial as a table, beside the random agent and the optimum.

    Sampled actions have no row where they are the agent's exploration, which says nothing of its policy.
    """
    trial = Trial.read(folder)
    config, anchors = trial.config, trial.anchors
    table = Table(title=trial.title)
    # A name is folded where it is too long; numbers are not.
    table.add_column("agent", overflow="fold")
    columns = _columns(trial)
    for column in columns:
        table.add_column(column.title, justify="right", no_wrap=True)
    modes = {"greedy": True} if trial.samples_to_explore else {"sampled": False, "greedy": True}
    shown = {
        f"{config.algo}, {mode}": records.means(trial.last_evaluation(deterministic=greedy))
        for mode, greedy in modes.items()
    }
    shown |= {name: {**trial.references[name], "return": getattr(anchors, name)} for name in REFERENCES}
    for name, means in shown.items():
        values = {**means, "normalized_score": anchors.score(means["return"])}
        table.add_row(name, *(column.form.format(round(values[column.mean], 2) + 0.0) for column in columns))
    return table


def legend(folder: Path) -> list[str]:
    """Return what the columns of `trial_table` mean, and what its numbers are means of, a line each."""
    trial = Trial.read(folder)
    config = trial.config
    lines = [f"{column.title.replace(chr(10), ' ')}: {column.meaning}" for column in _columns(trial)]
    lines.append(
        f"Means of {trial.n_evaluation_episodes} evaluation episodes after {config.steps} training "
        "steps; the returns of random and optimal are exact expectations."
    )
    if config.steps and config.phantom_set:
        lines.append(f"Trained on {config.phantom_set}; none of them is in the evaluation.")
    if trial.samples_to_explore:
        lines.append(f"{config.algo} samples actions only to explore, so that greedy actions are shown.")
    return lines


def print_trial(folder: Path, figures: dict[str, Path]) -> None:
    """Print the table of a finished trial, what it means, and where the trial's files are."""
    console = Console(highlight=False)
    console.width = max(console.width, NARROWEST)
    console.print(trial_table(folder))
    for line in [*legend(folder), not_learned(Trial.read(folder).config)]:
        if line:
            console.print(line, markup=False)
    # Plain prints: a path must not be wrapped.
    for name, path in {"trial folder": folder, **figures}.items():
        print(f"{name + ':':<16}{path}")
    quoted = shlex.quote(str(folder))
    print(f"{'next:':<16}usbench watch {quoted}")
    print(f"{'':<16}usbench {'guide' if _is_guided(Trial.read(folder).config) else 'report'} {quoted}")


def _is_guided(config: TrialConfig) -> bool:
    """Return whether the guide takes it: a learner of this package, on a task that moves the probe."""
    learned = config.steps > 0 and zoo.is_of_the_package(config.algo)
    return learned and suite.TASKS[config.task].is_guided


def duration(seconds: float) -> str:
    """Return about how long that is, in words: "about 40 s", "about 3 min", "about 2.5 h"."""
    if seconds < 95:
        return f"about {max(10 * round(seconds / 10), 10)} s"
    return f"about {round(seconds / 60)} min" if seconds < 6000 else f"about {seconds / 3600:.1f} h"


def not_learned(config: TrialConfig) -> str:
    """Return what a trial of so few steps did not learn from, in a sentence; "" if it learned from all."""
    steps, own = config.steps, zoo.own_defaults(config.algo)
    # A class counts the steps of each environment by default; hyperparameters count those of all.
    own |= {"n_steps": own["n_steps"] * config.n_envs} if "n_steps" in own else {}
    values = {**own, **config.hyperparameters}
    n_steps = zoo.rollout_steps(config.algo, values) or 1
    if 0 < steps < n_steps:
        return f"Nothing was learned in {steps} steps: the first update comes after {n_steps} (n_steps)."
    if rest := steps % n_steps:
        return f"The last {rest} of {steps} steps were not learned from: an update takes {n_steps}."
    if 0 < steps <= values.get("learning_starts", 0):
        return f"Nothing was learned in {steps} steps: learning starts after {values['learning_starts']}."
    return ""


def _columns(trial: Trial) -> list[Column]:
    """Return the columns that say something about the trial's task."""
    silent = row_of(trial.config.task).silent
    return [column for column in COLUMNS if column.mean not in silent]
