"""What a person has chosen on the page, what the page's buttons do, and all that it shows, as plain data."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from usbench import suite
from usbench.checks import as_configuration_error, check_seed
from usbench.guide import view
from usbench.guide.advisers import Advisers
from usbench.guide.agents import ORACLE, known
from usbench.guide.examination import Examination
from usbench.guide.guided import GUIDED, check_task
from usbench.guide.study import Study
from usbench.guide.study_record import agent_of
from usbench.guide.training import QuickTraining, can_train
from usbench.records import ConfigurationError
from usbench.setting import Setting

NOISES = (0.0, 0.25, 0.5)


class Session:
    """The examinations of one person, one after the other.

    Attributes:
        setting: Task, noise, anatomy, probe and imaging of the examinations.
        examination: The episode that is going on.
        advisers: The agents that can be chosen, and the one that advises.
        tasks: Tasks that can be chosen.
        hidden: Whether the object, and all that tells where it is, is hidden until the episode ends.
        training: Trains an agent on request.
        study: The study that is played; None if none is.
        n_begun: Number of examinations that were begun.
    """

    def __init__(
        self,
        runs: Path,
        trial: Path | None = None,
        *,
        seed: Any = None,
        tell: Callable[[str], None] = lambda _: None,
        study: str | None = None,
        **setting: Any,
    ) -> None:
        """Begin with the agent of `trial`, or with the best of its task in `runs`.

        Args:
            runs: Folder with trials; an agent that is trained here becomes a trial there.
            trial: Folder of a trial.
            seed: Of the episodes; None draws one.
            tell: Is told in words what is being done, whenever that may take long.
            study: Name of a study, whose episodes are played in place of others; None for none.
            setting: Attributes of a `Setting`: task, noise, probe, imaging. One that is missing or None is
                that of the trial; without a trial it is the default, and the task "pp".

        Raises:
            ConfigurationError: If a value is not allowed, or the trial's model cannot be used.
        """
        self._tell = tell
        own = None if trial is None else known(trial)
        given = Setting(task="pp") if own is None else own.setting.scored
        self.setting = _changed(given, GUIDED, setting)
        # Another task may not be possible in a custom anatomy.
        self.tasks = GUIDED if self.setting.anatomy is None else (self.setting.task,)
        self._seeds = np.random.default_rng(None if seed is None else _seed(seed))
        self.training, self.n_begun = QuickTraining(runs), 0
        self.hidden = False
        self.advisers = Advisers(runs, own, tell)
        self.advisers.begin(self.setting, self.tasks, None if study is None else agent_of(runs, study))
        if study is not None and self.advisers.opened is None:
            raise ConfigurationError(self.advisers.message)
        self.study = None if study is None else Study(runs, study, self.setting, self.advisers.name)
        if self.study is not None and self.advisers.opened is not None:
            self.study.complete(self.advisers.opened)
        self._begin()

    def begin(self) -> None:
        """Begin a new episode.

        Raises:
            ConfigurationError: If a study is played whose present episode is not over, or which is finished.
        """
        if self.study is not None and self.study.now is None:
            raise ConfigurationError(self.study.words)
        if self.study is not None and not self.examination.over:
            raise ConfigurationError("a study counts every episode: go on with this one to its end.")
        self._begin()

    def _begin(self) -> None:
        """Begin an episode: the next of the study, or a new one."""
        if self.study is None or self.study.now is None:
            seed, options = int(self._seeds.integers(2**31)), None
        else:
            seed, options = self.study.now.episode.seed, self.study.now.episode.options
        self.examination = Examination(self.setting, seed, self.advisers.opened, self._tell, options)
        self.n_begun += 1
        if self.study is not None:
            self._way, self.hidden = self.study.words, True
            self._shows_advice = self.study.now is not None and self.study.now.advised
            self.study.begin()

    @property
    def place(self) -> dict[str, Any]:
        """What a page shows that is up to date: task, agent, number of the examination and of its step."""
        return {
            "task": self.setting.task,
            "agent": self.advisers.name,
            "examination": self.n_begun,
            "step": len(self.examination.actions),
        }

    def act(self, action: Any) -> None:
        """Take an action; ValueError or TypeError if there is no such action, or the episode is over."""
        advice = self.examination.advice
        self.examination.act(action)
        if self.study is not None and self.study.now is not None:
            self.study.saw(advice.best if advice else None, self.examination.actions[-1])
            if self.examination.over and self.advisers.opened is not None:
                self._tell("recording the episode")
                self.study.finish(self.examination, self.advisers.opened)

    def follow(self) -> None:
        """Take the action that the agent advises; ValueError if nothing is advised, or a study is played."""
        self._no_study("the agent's step")
        self.examination.follow()

    def train(self) -> None:
        """Train an agent for this task and noise in the background.

        Raises:
            ConfigurationError: If anatomy, probe or imaging is not the default, or a study is played.
        """
        self._no_study("a training")
        self.training.start(self.setting)

    def update(self) -> None:
        """Notice how far the training is; once it is finished, let its agent advise.

        An agent or a task that was chosen meanwhile stays.
        """
        before = self.training.progress.status
        self.training.update()
        now = self.training.progress
        if before != "running" or now.status != "finished" or now.folder is None:
            return
        agents, name = self.advisers, now.folder.name
        agents.find(self.setting, self.tasks)
        if not agents.knows(name):
            return
        if now.task != self.setting.task:
            agents.notice = (
                f"Trained: there is an agent of the task {suite.TASKS[now.task].guidance.title} now."
            )
        elif agents.name == ORACLE:
            self.choose(agent=name)
            agents.notice = f"Trained: {agents.label()} advises from now on."
        else:
            agents.notice = f"Trained: {agents.label(name)} can be chosen as the agent."

    def choose(
        self, *, task: Any = None, noise: Any = None, agent: Any = None, hidden: bool | None = None
    ) -> None:
        """Change what is not None; another task or noise begins a new episode.

        Raises:
            ConfigurationError: If a value is not allowed.
        """
        self._no_study("another choice")
        before, chosen = self.setting, _changed(self.setting, self.tasks, {"task": task, "noise": noise})
        agents = self.advisers
        if agent is not None:
            agents.check(agent)
        if hidden not in (None, True, False):
            raise ConfigurationError(f"hidden must be true or false, not {hidden!r}.")
        self.hidden = self.hidden if hidden is None else bool(hidden)
        if chosen == before and agent is None:
            return
        agents.message, agents.notice, self.setting = "", "", chosen
        self._tell(f"changing to {chosen.task}, noise {chosen.noise:g}")
        if agent is None and chosen.task != before.task and not agents.fits(chosen.task):
            agents.choose_best(chosen)
        else:
            agents.choose(agents.name if agent is None else agent, chosen)
        if chosen == before:
            self.examination.ask(agents.opened)
        else:
            self._begin()

    def _no_study(self, what: str) -> None:
        if self.study is not None:
            raise ConfigurationError(f"{what} is not possible in a study: its episodes are the same for all.")

    def prepare(self) -> bool:
        """Simulate one of the frames to which the next action may lead; return False if there are all."""
        return self.examination.prepare()

    def close(self) -> None:
        """End a training that runs in the background, and let another guide go on with a study."""
        self.training.close()
        if self.study is not None:
            self.study.close()

    def state(self) -> dict[str, Any]:
        """Return all that the page shows, for JSON."""
        training = asdict(self.training.progress) | {"folder": None}
        return {
            "place": self.place,
            **self._choices(),
            **self.advisers.shown(),
            **view.seen(self.examination, hidden=self.hidden, for_good=self.study is not None),
            "advice": view.advice(self.examination) if self.study is None or self._shows_advice else None,
            "study": self._study_words(),
            "ended": self.study is not None and self.study.now is None,
            "training": training | {"offered": self._offers_training()},
            "untrained": self.advisers.missing(self.setting),
        }

    def _study_words(self) -> str:
        """Return which episode of the study is shown, or that it is finished; empty if none is played."""
        if self.study is None:
            return ""
        return self.study.words if self.study.now is None and self.examination.over else self._way

    def _choices(self) -> dict[str, Any]:
        tasks = {name: suite.TASKS[name].guidance.title for name in self.tasks}
        return {
            "tasks": tasks,
            "task": self.setting.task,
            "goal": self.examination.goal,
            "noises": sorted({*NOISES, self.setting.noise}),
            "noise": self.setting.noise,
            "hidden": self.hidden,
        }

    def _offers_training(self) -> bool:
        """Return whether an agent can be trained here, and none of the task is in the folder of trials."""
        own = self.advisers.are_for(self.setting.task, trained_here=True)
        return self.study is None and not own and can_train(self.setting)


def _changed(setting: Setting, tasks: Collection[str], values: Mapping[str, Any]) -> Setting:
    """Return `setting` with those of `values` that are not None; the task is one of `tasks`.

    Another task has its own senses and phantoms, and its own imaging where that was not chosen.
    """
    given = {name: value for name, value in values.items() if value is not None}
    if "task" in given:
        check_task(given["task"], tasks)
        if given["task"] != setting.task:
            usual = setting.imaging == Setting(task=setting.task).imaging
            given = {"senses": None, "n_phantoms": None, **({"imaging": None} if usual else {}), **given}
    return replace(setting, **given)


def _seed(seed: Any) -> int:
    with as_configuration_error():
        return check_seed(seed)
