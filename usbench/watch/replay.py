"""An evaluation episode played again from its record (seed, start, actions), as moving pictures."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from usbench import records, suite
from usbench.envs.pose import Pose
from usbench.records import Trial
from usbench.records.journal import read_rows
from usbench.setting import Setting
from usbench.watch import episode, film

if TYPE_CHECKING:  # asking an agent takes torch
    from usbench.watch.advice import Advice, Adviser

REPLAY = "replay.gif"


@dataclass(frozen=True)
class Moment:
    """What there is to see after one step, or at the start.

    Attributes:
        step: Steps made, 0 at the start.
        picture: Scene beside frame, (height, width, 3) uint8.
        action: What was done, "start" at the start.
        reward: For it.
        return_: Sum of rewards so far.
        optimum: The same of the best policy that knows the pose, from the same start and with the same slips.
        pose: Of the probe.
        distance_mm: What is left to go, as the task defines it.
        slip: What noise did to the probe after the action, in words; empty if nothing.
        is_success: Whether this pose is the goal.
        advice: What the agent advises now; None if it is not asked, and after the last step.
    """

    step: int
    picture: npt.NDArray[np.uint8]
    action: str
    reward: float
    return_: float
    optimum: float
    pose: Pose
    distance_mm: float
    slip: str
    is_success: bool
    advice: Advice | None


def last_evaluations(folder: Path, *, deterministic: bool) -> pd.DataFrame:
    """Return the records of the last checkpoint's episodes.

    Raises:
        ValueError: If the trial has no evaluations.
    """
    rows = pd.DataFrame(read_rows(folder / records.EVALUATIONS))
    if rows.empty:
        raise ValueError(f"{folder} has no evaluations to replay.")
    return rows[(rows["checkpoint"] == rows["checkpoint"].max()) & (rows["deterministic"] == deterministic)]


def typical_episode(folder: Path, *, deterministic: bool = False) -> dict[str, Any]:
    """Return the record of the last checkpoint's episode whose return is the median.

    Raises:
        ValueError: If the trial has no evaluations.
    """
    ordered = last_evaluations(folder, deterministic=deterministic).sort_values("return", kind="stable")
    return {str(key): value for key, value in ordered.iloc[len(ordered) // 2].items()}


def play(
    setting: Setting, eval_episode: int, actions: Sequence[int], *, adviser: Adviser | None = None
) -> Iterator[Moment]:
    """Yield what is seen at the start and after every recorded action."""
    planned = setting.evaluation_episodes()[eval_episode]
    names, guidance = action_names(setting.task), setting.guidance
    env = setting.scored.make_env(render_mode="rgb_array")
    observation, info = env.reset(seed=planned.seed, options=planned.options)
    optima = episode.optimum(setting.scored, planned.seed, planned.options)
    total, reward, name = 0.0, 0.0, "start"
    for step in range(len(actions) + 1):
        if step:
            observation, given, _, _, info = env.step(actions[step - 1])
            reward, name = float(given), names[actions[step - 1]]
            total += reward
        asked = adviser if step < len(actions) else None
        yield Moment(
            step=step,
            picture=np.asarray(env.render(), dtype=np.uint8),
            action=name,
            reward=reward,
            return_=total,
            optimum=optima[step],
            pose=guidance.pose(info),
            distance_mm=info["distance_mm"],
            slip=episode.slip(info["noise"]),
            is_success=info["is_success"],
            advice=asked.advise(observation, info, step) if asked else None,
        )
    env.close()


def action_names(task: str) -> list[str]:
    """Return what the actions of a task are called."""
    return [action.name for action in suite.TASKS[task].guidance.actions]


def write_gif(folder: Path) -> Path:
    """Write `replay.gif` of the trial's typical evaluation episode into its folder and return the path."""
    setting = Setting.recorded(Trial.read(folder).config)
    record = typical_episode(folder)
    moments = play(setting, int(record["eval_episode"]), record["actions"])
    path = folder / REPLAY
    names = action_names(setting.task)
    film.write(path, [film.page(moment, len(record["actions"]), names) for moment in moments])
    return path
