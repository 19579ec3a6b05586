"""What a person sees in the terminal when a trial has ended: a table, what it means, and paths."""

import shlex
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

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
    Column("return", "return", "{:z.2f}", "sum of the rewards of an episode"),
    Column("normalised\nscore", "normalized_score", "{:z.2f}", "0 is the random agent, 1 is the optimum"),
    Column("final\ndistance", "final_distance_mm", "{:z.1f} mm", "from the last pose to the goal"),
    Column(
        "plane\nerror",
        "plane_error_deg",
        "{:z.1f} deg",
        "angle between the last frame's plane and the object's, 0 to 90 degrees",
    ),
    Column("success\nrate", "success_rate", "{:.0%}", "share of the episodes whose last pose is the goal"),
)
# Characters: the numbers of all columns, and what is left for a name that is folded.
NARROWEST = 72


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
        table.add_row(name, *(column.form.format(values[column.mean]) for column in columns))
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


def not_learned(config: TrialConfig) -> str:
    """Return which part of the learning a trial was too short for, in a sentence; "" if none."""
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
