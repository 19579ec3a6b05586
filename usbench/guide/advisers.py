"""The agents that can be chosen on the page, and the one that advises."""

from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any

from usbench.checks import unknown
from usbench.guide import agents as guide_agents
from usbench.guide.agents import ORACLE, Known
from usbench.guide.examination import Opened
from usbench.records import ConfigurationError
from usbench.setting import Setting


class Advisers:
    """Agents of trials and of the package, and the exact optimum, of which one advises.

    Attributes:
        name: Name of the trial whose agent advises, or "oracle".
        opened: That agent, None where it cannot be used: then `message` says why.
        message: A sentence on what went wrong; empty if nothing did.
        notice: A sentence of good news; empty if there is none.
    """

    def __init__(self, runs: Path, given: Known | None, tell: Callable[[str], None]) -> None:
        """No agent is known before `begin`.

        Args:
            runs: Folder with trials.
            given: A trial that can always be chosen; None for none.
            tell: Is told in words what is being done, whenever that may take long.
        """
        self._runs, self._given, self._tell = runs, given, tell
        self.name, self.message, self.notice = ORACLE, "", ""
        self.opened: Opened | None = None
        self._trials: dict[str, Known] = {}
        self._others: list[Known] = []

    def begin(self, setting: Setting, tasks: Collection[str], recorded: str | None) -> None:
        """Look for trials, and let the given trial's agent advise, or without one that of `choose_best`.

        Raises:
            ConfigurationError: If the model of the given trial cannot be used.
        """
        self.find(setting, tasks)
        if self._given is None:
            self.choose_best(setting, recorded)
        else:
            self.opened = guide_agents.open_trial(self._given, setting)
            self.name = self._given.name

    def find(self, setting: Setting, tasks: Collection[str]) -> None:
        """Look for trials: those whose agents can be chosen for `tasks`, and those that met other images."""
        self._tell(f"looking for agents in {self._runs}")
        known = guide_agents.find(self._runs)
        self._others = [one for one in known if one.setting.differences(setting)]
        fitting = [one for one in known if one.task in tasks and one not in self._others]
        # The agent that advises stays, also if its folder is gone or cannot be read at this moment.
        kept = [one for one in (self._given, self._trials.get(self.name)) if one is not None]
        self._trials = {trial.name: trial for trial in (*fitting, *kept)}

    def knows(self, name: str) -> bool:
        """Return whether there is a trial of that name."""
        return name in self._trials

    def check(self, name: object) -> None:
        """Refuse what is no name of an agent.

        Raises:
            ConfigurationError: If it is none; the message says which there are.
        """
        names = [ORACLE, *self._trials]
        if name not in names:
            raise ConfigurationError(str(unknown("agent", name, names)))

    def are_for(self, task: str, *, trained_here: bool = False) -> bool:
        """Return whether an agent of the task can be chosen, of this folder if it must be `trained_here`."""
        return any(
            one.task == task and not (trained_here and one.is_released) for one in self._trials.values()
        )

    def fits(self, task: str) -> bool:
        """Return whether the agent that advises was trained on the task."""
        return self.name in self._trials and self._trials[self.name].task == task

    def choose(self, name: str, setting: Setting) -> None:
        """Let the agent of that name advise, which `check` has let pass."""
        self.name = name
        self._open(setting)

    def choose_best(self, setting: Setting, recorded: str | None = None) -> None:
        """Let the best agent of the task advise, or that which a study has recorded, or else the optimum."""
        before = self._trials.get(self.name)
        chosen = self._trials.get(recorded or "")
        # A study of another task says so itself.
        if chosen is not None and chosen.task != setting.task:
            chosen = None
        best = chosen or guide_agents.best(self._trials.values(), setting)
        if recorded == ORACLE:
            best = None
        self.choose(ORACLE if best is None else best.name, setting)
        if before is None or before.task == setting.task or self.message:
            return
        if best is None:
            self.message = (
                f"{before.name} was trained on another task and does not fit this one: "
                f"{self.label()} advises here."
            )
        else:
            self.notice = f"{best.name} advises here: {before.name} was trained on another task."

    def _open(self, setting: Setting) -> None:
        """Open the agent that is chosen, or say why that cannot be."""
        self._tell(f"opening {self.label()}")
        self.opened = None
        try:
            if self.name == ORACLE:
                self.opened = guide_agents.open_oracle(setting)
            else:
                self.opened = guide_agents.open_trial(self._trials[self.name], setting)
        except ConfigurationError as error:
            self.message = str(error)

    def label(self, name: str | None = None) -> str:
        """Return how an agent is called on the page; None means the one that advises."""
        name = self.name if name is None else name
        return "the exact optimum" if name == ORACLE else self._labels()[name]

    def _labels(self) -> dict[str, str]:
        return guide_agents.labels(self._trials.values())

    def shown(self) -> dict[str, Any]:
        """Return what the page shows of them, for JSON."""
        labels = self._labels()
        agents = [
            {"name": name, "label": labels[name], "task": trial.task} for name, trial in self._trials.items()
        ]
        return {
            "agents": [
                *agents,
                {"name": ORACLE, "label": "the exact optimum (knows the pose)", "task": None},
            ],
            "agent": self.name,
            "label": self.label(),
            "exact": self.name == ORACLE,
            "message": self.message,
            "notice": self.notice,
        }

    def missing(self, setting: Setting) -> str:
        """Return in a sentence why no agent of the task can be chosen; empty if one can."""
        if self.are_for(setting.task):
            return ""
        others = sorted(
            {
                one
                for trial in self._others
                if trial.task == setting.task
                for one in trial.setting.differences(setting)
            }
        )
        if others:
            return (
                f"Every agent of this task was trained with another {' or '.join(others)}; "
                "the exact optimum advises."
            )
        return "No agent is trained for this task yet; the exact optimum advises."
