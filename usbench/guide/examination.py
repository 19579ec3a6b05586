"""An examination: one episode in which a person or an agent moves the probe, and what an agent advises."""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from usbench.checks import whole_number
from usbench.envs.frames import frame_store
from usbench.envs.pose import Move
from usbench.setting import Setting
from usbench.trials.recorder import Recorder
from usbench.watch import episode
from usbench.watch.moment import Advice


class Asked(Protocol):
    """What advises, step by step; an episode begins with step 0."""

    def advise(self, observation: Any, info: dict[str, Any], step: int) -> Advice:
        """Return the advice after `step` steps."""
        ...


@dataclass(frozen=True)
class Opened:
    """An agent that can be asked, and what it sees: how many frames at once, and which senses beside them."""

    adviser: Asked
    n_frames: int = 1
    senses: tuple[str, ...] | None = ()


class Examination:
    """One episode, step by step.

    Attributes:
        setting: Task, noise, anatomy, probe and imaging.
        actions: The actions so far.
        optimum: Return of the best policy that knows the pose, after every number of steps, from the same
            start and with the same slips.
        start: Where the probe was when the episode began.
        pose: Where the probe is.
        return_: Sum of the rewards so far.
        slip: How the probe slipped after the last action, in words; empty if it did not.
        blocked: Whether the last action would have moved the probe beyond its limits.
        facts: Of the episode as evaluations record it, fields of `records.Evaluation`; empty before its end.
        at_goal: Whether this pose is the goal.
        advice: The agent's advice for the next action; None without an agent, and at the end.
    """

    def __init__(
        self,
        setting: Setting,
        seed: int,
        agent: Opened | None = None,
        tell: Callable[[str], None] = lambda _: None,
        options: Mapping[str, int] | None = None,
    ) -> None:
        """Begin an episode whose start and slips come from `seed`; `tell` hears what may take long."""
        self.setting, self.guidance = setting, setting.guidance
        self.actions: list[int] = []
        self._seed, self._tell, self._options = seed, tell, options
        tell(f"computing the optimum of {setting.task}, noise {setting.noise:g}")
        self.optimum = episode.optimum(setting, seed, options)
        self.ask(agent)

    @property
    def n_steps(self) -> int:
        """Length of the episode."""
        return self.guidance.n_steps

    @property
    def over(self) -> bool:
        """Whether all steps are made, or the agent or the person has stopped."""
        return self._stopped or len(self.actions) == self.n_steps

    @property
    def frame(self) -> npt.NDArray[np.uint8]:
        """The B-mode frame from here, (height_px, width_px) uint8."""
        return frame_store(self.phantom, self.setting.probe, self.setting.imaging).frame(self.pose)

    def prepare(self) -> bool:
        """Simulate one of the frames to which the next action may lead; return False if there are all.

        What is advised comes first. Of a phantom that all episodes share, the frames are kept on disk.
        """
        pose = next(self._following, None)
        if pose is None:
            return False
        self._tell("simulating the next frame")
        store = frame_store(self.phantom, self.setting.probe, self.setting.imaging)
        if self.setting.row.phantoms:
            store.frame(pose)
        else:
            store.prepare([pose])
        return True

    @property
    def phantom(self) -> Any:
        """What is examined."""
        return self._env.unwrapped.phantom  # type: ignore[attr-defined]

    @property
    def goal(self) -> str:
        """What is to be done, in a sentence."""
        return (inspect.getdoc(type(self._env.unwrapped)) or "").partition("\n")[0]

    def score(self, return_: float) -> float:
        """Return the score of a return from this start: 0 is a random agent, 1 the mean optimum."""
        process = self.setting.process(self.phantom.target)
        return process.returns((self.start,)).score(return_)

    def ask(self, agent: Opened | None) -> None:
        """Let another agent advise, or none; the agent is shown the episode from the start."""
        done, self.actions = self.actions, []
        self._adviser = agent.adviser if agent else None
        sees = (
            {"n_frames": agent.n_frames, "senses": agent.senses} if agent else {"n_frames": 1, "senses": ()}
        )
        self.facts: dict[str, Any] = {}
        self._env = Recorder(replace(self.setting, **sees).make_env(), self.facts.update)
        self.return_, self.slip, self.blocked, self._stopped = 0.0, "", False, False
        self._tell("simulating the first frame")
        options = None if self._options is None else dict(self._options)
        self._look(*self._env.reset(seed=self._seed, options=options))
        self.start = self.pose
        for action in done:
            self.act(action)

    def act(self, action: Any) -> None:
        """Take one action.

        Raises:
            TypeError: If `action` is not a number.
            ValueError: If it is not an action of the task, or the episode is over.
        """
        action = whole_number("action", action, 0, len(self.guidance.actions) - 1)
        if self.over:
            raise ValueError(f"the episode is over after {len(self.actions)} steps: begin a new one.")
        move = self.guidance.actions[action].move
        self.blocked = move != Move() and self.pose.moved(move, self.guidance.limits) == self.pose
        self._tell("simulating the next frame")
        observation, reward, self._stopped, _, info = self._env.step(action)
        self.actions.append(action)
        self.return_ += float(reward)
        self._look(observation, info)

    def follow(self) -> None:
        """Take the action that the agent advises.

        Raises:
            ValueError: If none is advised.
        """
        if self.advice is None and not self.over:
            raise ValueError("nothing is advised: choose an agent that fits the task.")
        self.act(self.advice.best if self.advice else 0)

    def _look(self, observation: Any, info: dict[str, Any]) -> None:
        self.pose = self.guidance.pose(info)
        self.at_goal = bool(info["is_success"])
        self.slip = episode.slip(info["noise"])
        self.advice: Advice | None = None
        if self._adviser is not None and not self.over:
            self.advice = self._adviser.advise(observation, info, len(self.actions))
        moves = [] if self.over else [action.move for action in self.guidance.actions]
        if self.advice is not None:
            moves.insert(0, moves[self.advice.best])
        self._following = iter([self.pose, *(self.pose.moved(move, self.guidance.limits) for move in moves)])
