"""What a person has chosen on the page, what its buttons do, and all that it shows, as plain data."""

from collections.abc import Collection
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from usbench import suite
from usbench.agents.hyperparameters import check_seed
from usbench.checks import probability, unknown
from usbench.guide import agents as guide_agents
from usbench.guide import view
from usbench.guide.agents import ORACLE, Known
from usbench.guide.examination import GUIDED, Examination, Opened
from usbench.guide.training import QuickTraining
from usbench.records import ConfigurationError
from usbench.setting import Setting

NOISES = (0.0, 0.25, 0.5)


class Session:
    """The examinations of one person, one after the other.

    Attributes:
        examination: The episode that is going on.
        agent: Name of the trial whose agent advises, or "oracle".
        message: What the person should know, a sentence; empty if nothing.
        tasks: Those that can be chosen.
        hidden: Whether the object and all that tells where it is are hidden until the episode ends.
        training: Trains an agent on request.
        anatomy: The given trial's own; None for the tasks' phantom.
    """

    def __init__(
        self,
        runs: Path,
        trial: Path | None = None,
        *,
        task: str | None = None,
        noise: Any = None,
        seed: Any = None,
    ) -> None:
        """Begin with the agent of `trial`, or with the best of its task in `runs`.

        Args:
            runs: Folder with trials; what is trained here goes there.
            trial: Folder of a trial.
            task: Task to begin with (default: that of the trial, or "pp").
            noise: Probability of slips (default: that of the trial, or 0).
            seed: Of the episodes; None draws one.

        Raises:
            ConfigurationError: If a value is not allowed, or the trial's model cannot be used.
        """
        self._runs = runs
        self._given = None if trial is None else guide_agents.known(trial)
        self.anatomy = None if self._given is None else self._given.anatomy
        if task is None:
            task = "pp" if self._given is None else self._given.task
        if noise is None:
            noise = 0.0 if self._given is None else self._given.noise
        self._seeds = np.random.default_rng(None if seed is None else _seed(seed))
        self.training = QuickTraining(runs)
        self.agent, self.message, self.hidden = ORACLE, "", False
        self._task, self._noise = _task(task, GUIDED), _noise(noise)
        # Another task may not be possible in an anatomy of one's own.
        self.tasks = GUIDED if self.anatomy is None else (self._task,)
        self._find()
        if self._given is None:
            self._settle()
        else:
            self._opened: Opened | None = guide_agents.open_trial(self._given, self._task)
            self.agent = self._given.name
        self.begin()

    def _setting(self) -> Setting:
        return Setting(task=self._task, noise=self._noise, anatomy=self.anatomy)

    def begin(self) -> None:
        """Begin a new episode."""
        seed = int(self._seeds.integers(2**31))
        self.examination = Examination(self._setting(), seed, self._opened)

    def act(self, action: Any) -> None:
        """Take an action; ValueError or TypeError if there is none such, or the episode is over."""
        self.examination.act(action)

    def follow(self) -> None:
        """Take the action that the agent advises; ValueError if there is none."""
        self.examination.follow()

    def train(self) -> None:
        """Train an agent for what is chosen now, in the background; in the tasks' phantom alone."""
        self.training.start(self._task, self._noise)

    def choose(
        self, *, task: Any = None, noise: Any = None, agent: Any = None, hidden: bool | None = None
    ) -> None:
        """Change what is given; another task or noise begins a new episode.

        Raises:
            ConfigurationError: If a value is not allowed.
        """
        chosen = (
            self._task if task is None else _task(task, self.tasks),
            self._noise if noise is None else _noise(noise),
        )
        names = [ORACLE, *self._trials]
        if agent is not None and agent not in names:
            raise ConfigurationError(str(unknown("agent", agent, names)))
        self.hidden = self.hidden if hidden is None else bool(hidden)
        if chosen == (self._task, self._noise) and agent is None:
            return
        self.message, begins = "", chosen != (self._task, self._noise)
        changes_task = chosen[0] != self._task
        self._task, self._noise = chosen
        if agent is not None:
            self.agent = agent
            self._open()
        elif changes_task:
            self._settle()
        else:
            self._open()
        if begins:
            self.begin()
        else:
            self.examination.ask(self._opened)

    def close(self) -> None:
        """End what runs in the background."""
        self.training.close()

    def state(self) -> dict[str, Any]:
        """Return all that the page shows, for JSON."""
        training = self.training.progress()
        if training.status == "finished" and training.folder and training.folder.name not in self._trials:
            self._welcome(training.folder.name, training.task)
        return {
            **self._choices(),
            **view.seen(self.examination, hidden=self.hidden),
            "advice": view.advice(self.examination),
            "training": asdict(training) | {"folder": None, "offered": self._offers_training()},
        }

    def _welcome(self, name: str, task: str) -> None:
        """Let an agent advise that has just been trained, unless something else was chosen meanwhile."""
        self._find()
        if name in self._trials and self.agent == ORACLE and task == self._task:
            self.choose(agent=name)
            self.message = f"Trained: {self._label()} advises from now on."

    def _choices(self) -> dict[str, Any]:
        tasks = {name: suite.TASKS[name].guidance.title for name in self.tasks}
        agents = [
            {"name": trial.name, "label": trial.label, "task": trial.task} for trial in self._trials.values()
        ]
        return {
            "tasks": tasks,
            "task": self._task,
            "goal": self.examination.goal,
            "noises": sorted({*NOISES, self._noise}),
            "noise": self._noise,
            "agents": [*agents, {"name": ORACLE, "label": "the exact optimum", "task": None}],
            "agent": self.agent,
            "label": self._label(),
            "exact": self.agent == ORACLE,
            "message": self.message,
            "hidden": self.hidden,
        }

    def _label(self) -> str:
        return "the exact optimum" if self.agent == ORACLE else self._trials[self.agent].label

    def _offers_training(self) -> bool:
        return self.anatomy is None and all(trial.task != self._task for trial in self._trials.values())

    def _find(self) -> None:
        given = [] if self._given is None else [self._given]
        known = guide_agents.find(self._runs)
        found = [*(one for one in known if one.task in self.tasks and one.anatomy == self.anatomy), *given]
        self._trials: dict[str, Known] = {trial.name: trial for trial in found}

    def _settle(self) -> None:
        """Let the best agent of the task advise, or the optimum where there is none."""
        before = self._trials.get(self.agent)
        best = guide_agents.best(self._trials.values(), self._task, self._noise)
        self.agent = ORACLE if best is None else best.name
        self._open()
        if before is not None and before.task != self._task and not self.message:
            self.message = (
                f"{before.name} was trained on another task and does not fit this one: "
                f"{self._label()} advises here."
            )

    def _open(self) -> None:
        """Open the agent that is chosen, or say why that cannot be."""
        self._opened = None
        try:
            if self.agent == ORACLE:
                self._opened = guide_agents.open_oracle(self._task, self._noise)
            else:
                self._opened = guide_agents.open_trial(self._trials[self.agent], self._task)
        except ConfigurationError as error:
            self.message = str(error)


def _task(task: Any, allowed: Collection[str]) -> str:
    if isinstance(task, str) and task in suite.TASKS and task not in GUIDED:
        raise ConfigurationError(
            f"the guide shows tasks that move the probe alone, not {task!r}: allowed are "
            f"{', '.join(map(repr, allowed))}."
        )
    if not isinstance(task, str) or task not in allowed:
        raise ConfigurationError(str(unknown("task", task, allowed)))
    return task


def _noise(noise: Any) -> float:
    try:
        return probability("noise", noise)
    except (TypeError, ValueError) as error:
        raise ConfigurationError(str(error)) from error


def _seed(seed: Any) -> int:
    try:
        return check_seed(seed)
    except (TypeError, ValueError) as error:
        raise ConfigurationError(str(error)) from error
