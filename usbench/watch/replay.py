"""An evaluation episode played again from its record (seed, start, actions), as moments."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from usbench.records import REPLAY, Trial
from usbench.setting import Setting
from usbench.watch import episode, film
from usbench.watch.moment import Ask, Moment


def typical(evaluation: pd.DataFrame) -> dict[str, Any]:
    """Return the record of the episode of an evaluation whose return is the median."""
    ordered = evaluation.sort_values("return", kind="stable")
    return {str(key): value for key, value in ordered.iloc[len(ordered) // 2].items()}


def play(
    setting: Setting, eval_episode: int, actions: Sequence[int], *, ask: Ask | None = None
) -> Iterator[Moment]:
    """Yield the moments of an evaluation episode: the start, and one after every recorded action.

    An agent, if there is one to `ask`, advises in each of them but the last.
    """
    planned = setting.evaluation_episodes()[eval_episode]
    names, guidance = action_names(setting), setting.guidance
    env = setting.scored.make_env(render_mode="rgb_array")
    observation, info = env.reset(seed=planned.seed, options=planned.options)
    optima = episode.optimum(setting.scored, planned.seed, planned.options)
    total, reward, name, over = 0.0, 0.0, "start", False
    for step in range(len(actions) + 1):
        if step:
            observation, given, *ends, info = env.step(actions[step - 1])
            over = any(ends)
            reward, name = float(given), names[actions[step - 1]]
            total += reward
        yield Moment(
            step=step,
            picture=np.asarray(env.render(), dtype=np.uint8),
            action=name,
            reward=reward,
            return_=total,
            # Who stops earns what is left of the episode at once.
            optimum=optima[-1] if over else optima[step],
            pose=guidance.pose(info),
            distance_mm=info["distance_mm"],
            slip=episode.slip(info["noise"]),
            is_success=info["is_success"],
            advice=ask(observation, info, step) if ask and step < len(actions) else None,
        )
    env.close()


def action_names(setting: Setting) -> list[str]:
    """Return the names of the actions."""
    return [action.name for action in setting.guidance.actions]


def write_gif(folder: Path) -> Path:
    """Write `replay.gif` of a trial into its folder: its typical evaluation episode with greedy actions."""
    trial = Trial.read(folder)
    setting, record = Setting.recorded(trial.config), typical(trial.last_evaluation(deterministic=True))
    names, steps = action_names(setting), len(record["actions"])
    moments = play(setting, int(record["eval_episode"]), record["actions"])
    film.write(folder / REPLAY, [film.page(moment, steps, names) for moment in moments])
    return folder / REPLAY
