"""The agents that a guide can ask: trials that are found in folders, and the exact optimum."""

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from usbench import records, suite
from usbench.agents import zoo
from usbench.envs.anatomy import Anatomy
from usbench.guide.examination import GUIDED, Opened
from usbench.records import ConfigurationError, Trial
from usbench.setting import Setting
from usbench.trials.model_loading import load_agent
from usbench.watch.advice import Adviser

ORACLE = "oracle"


@dataclass(frozen=True)
class Known:
    """A trial whose agent can be asked.

    Attributes:
        folder: Of the trial.
        task: What it was trained on.
        noise: What it was trained with.
        label: What the page calls it.
        score: Normalised score of its last evaluation with likeliest actions; None if there is none.
        anatomy: One's own that it was trained in; None for the task's phantom.
    """

    folder: Path
    task: str
    noise: float
    label: str
    score: float | None
    anatomy: Anatomy | None = None

    @property
    def name(self) -> str:
        """Name of the trial."""
        return self.folder.name


def find(runs: Path) -> list[Known]:
    """Return the trials in `runs` that left a model, by name; a trial that cannot be read is left out."""
    found = [trial for path in records.trial_folders(runs) if (trial := _known(path))]
    return sorted(found, key=lambda trial: trial.name)


def known(folder: Path) -> Known:
    """Return the trial in `folder`.

    Raises:
        ConfigurationError: If there is no trial of an agent that learns.
    """
    if not (folder / records.TRIAL).is_file():
        raise ConfigurationError(f"{str(folder)!r} is not the folder of a trial: no {records.TRIAL} in it.")
    trial = _known(folder.resolve())
    if trial is None:
        load_agent(folder)  # knows why not
        raise ConfigurationError(f"{str(folder)!r} is not the trial of an agent that learns.")
    return trial


def best(trials: Iterable[Known], task: str, noise: float) -> Known | None:
    """Return the best agent of `task`, one trained with this noise before all others."""
    fitting = [trial for trial in trials if trial.task == task and trial.score is not None]
    return max(fitting, key=lambda trial: (trial.noise == noise, trial.score), default=None)


def open_trial(trial: Known, task: str) -> Opened:
    """Open the agent of a trial; nothing in its files is run.

    Raises:
        ConfigurationError: If it does not fit `task` or cannot be opened; one sentence says why.
    """
    if trial.task != task:
        own, asked = (_title(name) for name in (trial.task, task))
        raise ConfigurationError(
            f"This model does not fit: {trial.name} was trained on the task {own}, not on {asked}."
        )
    loaded = load_agent(trial.folder)
    return Opened(Adviser(loaded.agent), loaded.config.n_frames)


def open_oracle(task: str, noise: float) -> Opened:
    """Return the exact optimum as an agent: it knows where the probe and the object are."""
    setting = Setting(task=task, noise=noise)
    return Opened(Adviser(zoo.make("oracle", setting.make_env(), 0, {}, policy=setting.planner())))


def _title(task: str) -> str:
    return f"{suite.TASKS[task].guidance.title!r} ({task})"


def _known(folder: Path) -> Known | None:
    """Return what `trial.json` says; it may come from a stranger, so that anything can be wrong with it."""
    try:
        trial = Trial.read(folder)
        config, score = trial.config, _score(trial)
        algo, task, noise = config.algo, config.task, config.noise
        if task not in GUIDED or not (folder / records.MODEL).is_file():
            return None
        if algo in zoo.ZOO and not zoo.ZOO[algo].learns:
            return None
        anatomy = Setting.recorded(config).anatomy
        label = f"{algo}, seed {config.seed}, noise {noise:g}"
    except (ValueError, TypeError, KeyError, OSError):
        return None
    label += "" if score is None else f", score {score:.2f}"
    return Known(folder, task, noise, label, score, anatomy)


def _score(trial: Trial) -> float | None:
    path = trial.folder / records.EVALUATIONS
    lines = path.read_bytes().splitlines() if path.is_file() else []
    # Greedy actions come last at every evaluation point.
    rows = [json.loads(line) for line in lines[-trial.n_evaluation_episodes :]]
    if not rows or not all(row["deterministic"] for row in rows):
        return None
    return trial.anchors.score(sum(row["return"] for row in rows) / len(rows))
