"""The agents that a guide can ask: trials that are found in folders, and the exact optimum."""

import json
import math
from collections import Counter
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from usbench import records, released
from usbench.agents import zoo
from usbench.ceilings import taught
from usbench.coordinates import TARGET
from usbench.envs.oracle import Planner
from usbench.guide.examination import Opened
from usbench.guide.guided import GUIDED, check_shown, check_task_of_agent
from usbench.records import ConfigurationError, Trial
from usbench.records.journal import UNREADABLE
from usbench.results.text import number
from usbench.setting import Setting
from usbench.trials.model_loading import load_agent
from usbench.watch.advice import Adviser
from usbench.watch.moment import Advice

ORACLE = "oracle"


class ExactAdviser:
    """The exact optimum, which knows where the probe and the object are."""

    def __init__(self, planner: Planner) -> None:
        """Advise what `planner` finds best."""
        self._planner = planner

    def advise(self, observation: Any, info: dict[str, Any], step: int) -> Advice:
        """Return the expected return of every action to the end of the episode, undiscounted."""
        target = tuple(info[name] for name in TARGET) if TARGET[0] in info else None
        pose = tuple(info[name] for name in self._planner.coordinates)
        return Advice(tuple(self._planner.policy(target).returns(step, pose).tolist()), "return")


@dataclass(frozen=True)
class Known:
    """A trial whose agent can be asked.

    Attributes:
        folder: Of the trial.
        setting: What the agent met in training.
        title: Algorithm, steps, seed and noise in words; how its training stands, if that is not finished.
        score: Normalised score of its last evaluation with greedy actions; None if there is none.
        is_taught: Whether it was told the truth while it learned.
    """

    folder: Path
    setting: Setting
    title: str
    score: float | None
    is_taught: bool = False

    @property
    def name(self) -> str:
        """Name of the trial, or of the agent that comes with the package."""
        return released.agent_in(self.folder)

    @property
    def is_released(self) -> bool:
        """Whether it comes with the package."""
        return self.folder.parent == released.FOLDER

    @property
    def task(self) -> str:
        """The task on which the agent was trained."""
        return self.setting.task

    @property
    def label(self) -> str:
        """Its title and its score in words."""
        return self.title + ("" if self.score is None else f", score {number(self.score, 2)}")


def labels(trials: Collection[Known]) -> dict[str, str]:
    """Return what the page calls each trial, by name; that name is told where another has the same title."""
    like = Counter((trial.task, trial.title) for trial in trials)
    return {
        trial.name: trial.label + (f" ({trial.name})" if like[trial.task, trial.title] > 1 else "")
        for trial in trials
    }


def find(runs: Path) -> list[Known]:
    """Return the trials in `runs` that left a model, by name, then the agents that come with the package.

    A trial that cannot be read is left out.
    """
    trials = sorted(records.trial_folders(runs), key=lambda path: path.name)
    named = [path for path in trials if path.name != ORACLE]  # it would be taken for the exact optimum
    return [trial for path in (*named, *released.folders()) if (trial := _known(path))]


def known(folder: Path) -> Known:
    """Return the trial in `folder`, which may be the name of an agent that comes with the package.

    Raises:
        ConfigurationError: If there is no trial of an agent that learns.
    """
    name, folder = str(folder), released.place(folder)
    if not (folder / records.TRIAL).is_file():
        raise records.no_trial(folder)
    if folder.resolve().name == ORACLE:
        raise ConfigurationError(f"a trial's folder must not be named {ORACLE!r}, as the exact optimum is.")
    trial = _known(folder.resolve())
    if trial is None:
        check_shown(name, load_agent(folder).config.task)  # loading raises the error that says why
        raise ConfigurationError(f"{name!r} is not the trial of an agent that learns.")
    return trial


def best(trials: Iterable[Known], setting: Setting) -> Known | None:
    """Return the best agent of the setting's task; one trained with the setting's noise comes first.

    Of these, one that was told the truth while it learned comes last.
    """
    fitting = [trial for trial in trials if trial.task == setting.task and trial.score is not None]
    return max(
        fitting,
        key=lambda trial: (trial.setting.noise == setting.noise, not trial.is_taught, trial.score),
        default=None,
    )


def open_trial(trial: Known, setting: Setting) -> Opened:
    """Open the agent of a trial; nothing in its files is run.

    Raises:
        ConfigurationError: If it does not fit `setting` or cannot be opened; one sentence says why.
    """
    check_task_of_agent(trial.name, trial.task, setting.task)
    if others := trial.setting.differences(setting):
        raise ConfigurationError(
            f"This model does not fit: {trial.name} was trained with another {' and another '.join(others)}."
        )
    loaded = load_agent(trial.folder)
    return Opened(Adviser(loaded.agent), trial.setting.n_frames, trial.setting.senses)


def open_oracle(setting: Setting) -> Opened:
    """Return the exact optimum as an agent: it knows where the probe and the object are."""
    return Opened(ExactAdviser(setting.planner()))


def _known(folder: Path) -> Known | None:
    """Return the trial that `trial.json` describes, None if it has no agent to ask or cannot be read.

    The file may come from a stranger, so that anything can be wrong with it.
    """
    try:
        trial = Trial.read(folder)
        config, score = trial.config, _score(trial)
        if config.task not in GUIDED or not records.model_in(folder).is_file():
            return None
        if ":" in config.algo:  # code from outside, which would run
            return None
        if config.algo in zoo.ZOO and not zoo.ZOO[config.algo].learns:
            return None
        setting = Setting.recorded(config)
        own = f"{released.name_of(folder)}: " if folder.parent == released.FOLDER else ""
        title = f"{own}{config.algo}, {config.steps} steps, seed {config.seed}, noise {config.noise:g}"
    except (*UNREADABLE, TypeError, KeyError, ArithmeticError, OSError):
        return None
    title += "" if trial.status == "finished" else f", {trial.status}"
    return Known(folder, setting, title, score, taught(config.algo) != "")


def _score(trial: Trial) -> float | None:
    """Return the score of the last evaluation with greedy actions, None without a finite one.

    Only its lines are parsed: `Trial.last_evaluation` takes 49 ms for a trial of the benchmark, 10 s for 200.
    """
    path = trial.folder / records.EVALUATIONS
    # A crash may have torn the last line.
    lines = path.read_bytes().rpartition(b"\n")[0].splitlines() if path.is_file() else []
    # Greedy actions come last at every evaluation point.
    rows = [json.loads(line) for line in lines[-trial.n_evaluation_episodes :]]
    if not rows or not all(row["deterministic"] for row in rows):
        return None
    mean = float(sum(row["return"] for row in rows)) / len(rows)
    return trial.anchors.score(mean) if math.isfinite(mean) else None
