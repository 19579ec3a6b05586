"""One trial for each agent and task, shown on the page: its replay, and a map of its actions."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont

from usbench import records
from usbench.envs.pose import Pose
from usbench.envs.scene import drawing
from usbench.envs.task import Task
from usbench.figures import policy_map, state_map
from usbench.records import ConfigurationError, Trial
from usbench.report import pictures
from usbench.report.pictures import Picture
from usbench.report.poses import Poses, silence
from usbench.report.tables import Table
from usbench.results import scores
from usbench.results.agents import named
from usbench.results.tables import Results
from usbench.results.text import number
from usbench.setting import Setting
from usbench.watch import film, panels, replay
from usbench.watch.moment import Moment

# Pixels.
REPLAY_WIDTH, MARGIN, TEXT_SIZE, LINE = 560, 12, 15, 20


@dataclass(frozen=True)
class Shown:
    """A trial that stands for an agent on a task.

    Attributes:
        agent: The algorithm, and its configuration where there are several.
        task: Name of the task.
        noise: The lowest noise with a finished trial of this agent.
        trial: Name of the folder: of the trials with this noise, the one with the median score.
        score: Score of that trial.
        trials: All finished trials of the agent with this task and noise.
        learns: Whether the agent learns.
        frames: Digest of the frames that the agent saw.
    """

    agent: str
    task: str
    noise: float
    trial: str
    score: float
    trials: tuple[str, ...]
    learns: bool
    frames: str


@dataclass(frozen=True)
class Replay:
    """A typical episode: as a film, as a picture of its end, in words, and its return beside the optimum."""

    film: Picture
    still: Picture
    words: str
    total: str
    optimum: str


@dataclass(frozen=True)
class Card:
    """What there is to see of an agent on a task.

    Attributes:
        shown: The trial.
        setting: What its agent meets.
        replay: A typical episode.
        map: Map of its greedy actions in every pose; None if there is no map.
        silence: Why there is no map.
        accuracy: How good the actions are, over all trials, as a row of `accuracy_table`.
    """

    shown: Shown
    setting: Setting
    replay: Replay
    map: Picture | None = None
    silence: str = ""
    accuracy: tuple[str, ...] = ()


def shown(known: Results) -> list[Shown]:
    """Return a trial for each task and agent: tasks in order, agents that learn first, best first."""
    last = scores.last(known)[["trial", "normalized_score"]]
    table = named(known.trials).merge(last, on="trial")
    chosen = []
    for (task, agent), own in table.groupby(["task", "agent"]):
        noise = own["noise"].min()
        rows = own[own["noise"] == noise].sort_values(["normalized_score", "seed"], ignore_index=True)
        median = rows.iloc[(len(rows) - 1) // 2]
        chosen.append(
            Shown(
                str(agent),
                str(task),
                float(noise),
                str(median["trial"]),
                float(median["normalized_score"]),
                tuple(sorted(rows["trial"])),
                bool(median["steps"] > 0),
                str(median["frames"]),
            )
        )
    return sorted(chosen, key=lambda one: (one.task, not one.learns, -one.score, one.agent))


def card(runs: Path, one: Shown, poses: Poses | None) -> Card:
    """Return what there is to see of an agent; its trials are folders in `runs`; no map without `poses`."""
    trial = Trial.read(runs / one.trial)
    setting = Setting.recorded(trial.config)
    found = Card(one, setting, play(trial, setting, one.agent))
    if not one.learns:
        return found
    if poses is None or silence(setting):
        return replace(found, silence=silence(setting))
    missing = [trial for trial in one.trials if not records.model_in(runs / trial).is_file()]
    if missing:
        return replace(found, silence=f"{missing[0]} has no weights.")
    from usbench.report import actions  # opens agents, which takes torch

    try:
        taken = {trial: actions.greedy(runs / trial) for trial in one.trials}
    except ConfigurationError as error:
        # Not where this reader keeps the trials.
        return replace(found, silence=str(error).replace(f"{runs}/", ""))
    plan = setting.plan(setting.evaluation_phantoms()[0].target)
    lost = [policy_map.lost(plan, own) for own in taken.values()]
    best = np.mean([own == 0 for own in lost], axis=0)
    return replace(
        found,
        map=pictures.from_figure(policy_map.draw(plan, taken[one.trial])),
        accuracy=_accuracy(one, poses, best, np.mean(lost, axis=0)),
    )


def accuracy_table(cards: Sequence[Card], titles: Mapping[str, str], alike: float) -> Table | None:
    """Return how good the actions of all agents are, None without any."""
    rows = [card.accuracy for card in cards if card.accuracy]
    if not rows:
        return None
    return Table(
        "Poses in which the greedy action is as good as the best (%, mean over seeds), and the return that "
        f"it costs; look-alikes correlate by more than {alike:g} with a frame that needs another action",
        [
            "agent", "task", "noise", "seeds", "all poses (%)", "where episodes start (%)", "look-alikes (%)",
            "other poses (%)", "cost, all poses (return)", "cost, starts (return)",
        ],
        [(row[0], titles[row[1]], *row[2:]) for row in rows],
        2,
    )  # fmt: skip


def _accuracy(
    one: Shown, poses: Poses, best: npt.NDArray[np.float64], lost: npt.NDArray[np.float64]
) -> tuple[str, ...]:
    starts = [poses.task.indices[pose] for pose in poses.task.starts]
    every = np.full(len(best), True)
    return (
        one.agent,
        one.task,
        f"{one.noise:g}",
        str(len(one.trials)),
        *(number(100 * _mean(best[where]), 0) for where in (every, starts, poses.alike, ~poses.alike)),
        *(film.fixed(_mean(lost[where])) for where in (every, starts)),
    )


def _mean(values: npt.NDArray[np.float64]) -> float:
    return float(values.mean()) if len(values) else float("nan")


def play(trial: Trial, setting: Setting, agent: str) -> Replay:
    """Return the episode of median return of a trial's last evaluation, with greedy actions."""
    record = replay.typical(trial.last_evaluation(deterministic=True))
    moments = list(replay.play(setting, int(record["eval_episode"]), record["actions"]))
    moving, still = pictures.from_pages([_page(moment, len(moments) - 1) for moment in moments])
    words, end = f"{agent} {_words(setting.guidance, moments)}", moments[-1]
    return Replay(moving, still, words, film.fixed(end.return_), film.fixed(end.optimum))


def _page(moment: Moment, steps: int) -> Image.Image:
    """Return the views with a title above each and two lines below, whose letters are legible as they are."""
    views, starts = panels.side_by_side(moment.picture, REPLAY_WIDTH, REPLAY_WIDTH)
    height = LINE + len(views)
    page = Image.new("RGB", (REPLAY_WIDTH, height + 2 * LINE + MARGIN), drawing.BACKGROUND)
    page.paste(Image.fromarray(views), (0, LINE))
    draw, font = ImageDraw.Draw(page), ImageFont.load_default(size=TEXT_SIZE)
    for title, left in starts.items():
        draw.text((left, 0), title, fill=drawing.TEXT, font=font)
    words = [
        f"{moment.step}/{steps} {moment.action}{f', slipped {moment.slip}' if moment.slip else ''}",
        f"return {film.fixed(moment.return_)}    optimum {film.fixed(moment.optimum)}",
    ]
    for row, line in enumerate(words):
        draw.text((0, height + MARGIN // 2 + LINE * row), line, fill=drawing.TEXT, font=font)
    page.info["duration"] = film.LAST_STEP_MS if moment.step == steps else film.STEP_MS
    return page


def _words(task: Task, moments: Sequence[Moment]) -> str:
    """Return an episode in words, for those who do not see the pictures."""
    counts = [(name, len(list(same))) for name, same in groupby(moment.action for moment in moments[1:])]
    actions = ", ".join(name if count == 1 else f"{name} {count} times" for name, count in counts)
    taken = "takes the action" if len(counts) == 1 else "takes the actions"
    slips = sum(bool(moment.slip) for moment in moments)
    slipped = f", and slips {'once' if slips == 1 else f'{slips} times'}" if slips else ""
    goal = "the goal" if moments[-1].is_success else "not the goal"

    def place(pose: Pose) -> str:
        return state_map.name(task, task.indices[pose])

    return (
        f"starts at {place(moments[0].pose)}, {taken} {actions}{slipped}, and ends at "
        f"{place(moments[-1].pose)}, {goal}."
    )
