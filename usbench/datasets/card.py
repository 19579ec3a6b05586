"""The card of a data set: what is in it, who acted, and what it is not good for."""

import shlex
from collections.abc import Mapping, Sequence
from importlib.metadata import version

import numpy as np

from usbench import released
from usbench.anchors import Anchors
from usbench.datasets.episodes import BEST, Played
from usbench.records import Trial
from usbench.setting import Setting


def description(setting: Setting, who: Sequence[str]) -> str:
    """Return what the data set is, in a sentence."""
    told = f"what is told beside them ({', '.join(setting.senses)}), " if setting.senses else ""
    return (
        f"Simulated ultrasound probe guidance, {setting.guidance.title} ({setting.row.env_id}), noise "
        f"{setting.noise:g}, played by {', '.join(who)}: B-mode frames, {told}actions and true rewards; the "
        "pose is in the infos. `import usbench` registers the environment."
    )


def text(
    name: str,
    setting: Setting,
    agent: str,
    anchors: Anchors,
    played: Sequence[Played],
    seed: int,
    size_bytes: int,
) -> str:
    """Return the card as Markdown; `agent` and `seed` are those that `minari_files.write` was given."""
    who = list(dict.fromkeys(episode.agent for episode in played))
    noise = f" --noise {setting.noise!r}" if setting.noise else ""
    options = (
        f"--task {setting.task} --agent {shlex.quote(agent)} --episodes {len(played)}{noise} --seed {seed}"
    )
    n_steps = sum(len(episode.actions) for episode in played)
    draws = setting.row.phantoms > 0
    # Where phantoms are drawn, every seed has its own.
    distinct = len(
        {(episode.seed if draws else None, _start(episode), *episode.actions) for episode in played}
    )
    alike = "phantom, start and actions" if draws else "start and actions"
    phantoms = (
        "Phantoms of evaluations are never in a data set."
        if draws
        else "The phantom is always the same, and evaluations have it, too."
    )
    lines = [
        f"# {name}",
        description(setting, who),
        f"```\nusbench dataset {options}\n```",
        f"{len(played)} episodes, {distinct} of them distinct ({alike}), {n_steps} steps, "
        f"{size_bytes / 1e6:.1f} MB; written by usbench {version('usbench')}.",
        _table(anchors, played, {agent: _described(agent, setting.task) for agent in who}),
        "The normalised score is (return - random) / (optimal - random) with exact expectations, which "
        "`minari.get_normalized_score` computes, too. Agents that learned take greedy actions. `infos` hold "
        "the true pose, the distance and the number of the agent in the table: an agent that learns from "
        "them knows more than the frames.",
        "Frames are uint8, bit for bit what the environment shows: one frame per observation, where the "
        f"agents saw a stack of them, normalised. {phantoms} Frames are simulated: nothing in them is of a "
        "patient.",
    ]
    return "\n\n".join(lines) + "\n"


def _start(episode: Played) -> tuple[object, ...]:
    return tuple(values[0] for values in episode.infos.values())


def _described(agent: str, task: str) -> str:
    """Return the agent's name; of the best of the package with its trial, since a later one has another."""
    if agent != BEST:
        return agent
    return f"{agent} (`{Trial.read(released.place(f'{BEST}:{task}')).config.folder_name}`)"


def _table(anchors: Anchors, played: Sequence[Played], who: Mapping[str, str]) -> str:
    rows: list[tuple[str, ...]] = [("number", "agent", "episodes", "return", "score", "ends at the goal")]
    for number, (agent, described) in enumerate(who.items()):
        own = [episode for episode in played if episode.agent == agent]
        mean = float(np.mean([np.sum(episode.rewards) for episode in own]))
        success = np.mean([bool(episode.infos["is_success"][-1]) for episode in own])
        rows.append(
            (
                str(number),
                described.replace("|", r"\|"),
                str(len(own)),
                f"{mean:.2f}",
                f"{anchors.score(mean):.3f}",
                f"{100 * success:.0f} %",
            )
        )
    rows.insert(1, ("---",) * len(rows[0]))
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)
