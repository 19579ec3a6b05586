"""Evaluation episodes of a trial to look at: as a file, live in the terminal, or as a table of text."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pandas as pd
from rich.color import Color
from rich.console import Console
from rich.live import Live
from rich.style import Style
from rich.text import Text

from usbench.envs.scene import picture
from usbench.envs.scene.drawing import BACKGROUND
from usbench.envs.settings import in_words
from usbench.figures import style as drawing
from usbench.records import ConfigurationError, Trial, TrialConfig
from usbench.setting import Setting
from usbench.trials.model_loading import load_agent
from usbench.watch import film, replay
from usbench.watch.advice import Adviser
from usbench.watch.replay import Moment

# The rows that the panels of the scene share, with the probe above.
ROWS = (picture.TOP - 40, picture.BOTTOM)
GAP = 2
TEXT_LINES = 8
SHADES = " ░▒▓█"


@dataclass(frozen=True)
class Watched:
    """Episodes of one trial that are about to be played.

    Attributes:
        config: The trial's configuration.
        episodes: Their records.
        kind: Of their actions, "greedy" or "drawn".
        adviser: Asks the saved model; None if it cannot be opened.
        silence: Why it cannot.
    """

    config: TrialConfig
    episodes: list[dict[str, Any]]
    kind: str
    adviser: Adviser | None
    silence: str


def choose(folder: Path, numbers: Sequence[Any] = (), *, drawn: bool = False) -> Watched:
    """Return the episodes `numbers` of the last checkpoint, or the one whose return is the median.

    Raises:
        ConfigurationError: If `folder` is no trial with evaluations, or has no such episode.
    """
    try:
        config = Trial.read(folder).config
        rows = replay.last_evaluations(folder, deterministic=not drawn)
        typical = replay.typical_episode(folder, deterministic=not drawn)
    except ValueError as error:
        raise ConfigurationError(str(error)) from error
    by_number = {row["eval_episode"]: row for row in rows.to_dict("records")}
    for number in numbers:
        if number not in by_number:
            raise ConfigurationError(
                f"episode must be a whole number from 0 to {max(by_number)}, not {number!r}."
            )
    episodes = [by_number[number] for number in numbers] or [typical]
    kind = "drawn" if drawn else "greedy"
    try:
        return Watched(config, episodes, kind, Adviser(load_agent(folder).agent), "")
    except ConfigurationError as error:
        return Watched(config, episodes, kind, None, str(error))


def check_file(out: Path) -> Path:
    """Return `out` if a replay can be written there; ConfigurationError if not."""
    return drawing.check_file(out, film.FORMATS)


def title(watched: Watched, episode: dict[str, Any]) -> str:
    """Return which episode this is, in words."""
    config = watched.config
    return (
        f"{config.algo} on {config.task}, noise {config.noise:g}, seed {config.seed}: evaluation "
        f"episode {episode['eval_episode']} at step {episode['checkpoint']}, {watched.kind} actions"
    )


def write(watched: Watched, out: Path) -> None:
    """Write the episodes one after the other to `out`, .gif, .webp or .mp4."""
    names = replay.action_names(watched.config.task)
    film.write(
        out,
        [
            film.page(moment, len(episode["actions"]), names, title(watched, episode))
            for episode in watched.episodes
            for moment in _moments(watched, episode)
        ],
    )


def show(watched: Watched, console: Console | None = None) -> None:
    """Play the episodes in the terminal, or print them as tables where there is none."""
    console = console or Console()
    for episode in watched.episodes:
        if console.is_terminal:
            _live(watched, episode, console)
        else:
            print(title(watched, episode))
            print(table(_moments(watched, episode), replay.action_names(watched.config.task)))


def table(moments: Iterator[Moment], names: Sequence[str]) -> str:
    """Return an episode as text: a row for the start and for every step."""
    rows = [
        {
            "step": moment.step,
            "action": moment.action,
            "reward": film.fixed(moment.reward),
            "return": film.fixed(moment.return_),
            "optimum": film.fixed(moment.optimum),
            "x (mm)": moment.pose.x_mm,
            "focus (mm)": moment.pose.focal_depth_mm,
            "angle (deg)": moment.pose.angle_deg,
            **({"settings": ", ".join(words)} if (words := in_words(moment.pose)) else {}),
            "distance (mm)": f"{moment.distance_mm:g}",
            "slip": moment.slip,
            "advice for the next": ""
            if moment.advice is None
            else film.advice_words(moment.advice, names)[moment.advice.best],
        }
        for moment in moments
    ]
    return str(pd.DataFrame(rows).to_string(index=False))


def screen(moment: Moment, steps: int, names: Sequence[str], console: Console) -> Text:
    """Return what the terminal shows of a moment: the scene beside the frame, and what is happening."""
    width, height = console.size
    image, starts = panels(moment.picture, width, height - TEXT_LINES)
    text = Text()
    heads = " " * width
    for name, start in zip(picture.panels(moment.picture.shape[1]), starts, strict=True):
        heads = heads[:start] + name + heads[start + len(name) :]
    text.append(heads[:width].rstrip() + "\n", style="bold")
    text.append_text(blocks(image, colored=console.color_system is not None))
    pose = moment.pose
    text.append(f"step {moment.step}/{steps}: {moment.action}", style="bold")
    where = [f"x {pose.x_mm} mm", f"focus {pose.focal_depth_mm} mm", f"angle {pose.angle_deg}°"]
    text.append("".join(f"   {part}" for part in [*where, *in_words(pose)]) + "\n")
    text.append("\n".join(film.facts(moment)) + "\n")
    if moment.advice is not None:
        text.append("advice: ")
        for number, words in enumerate(film.advice_words(moment.advice, names)):
            best = number == moment.advice.best
            text.append(f"[{words}]" if best else words, style="bold" if best else "")
            text.append("  ")
    return text


def panels(scene: npt.NDArray[np.uint8], width: int, height: int) -> tuple[npt.NDArray[np.uint8], list[int]]:
    """Return the scene's panels side by side for `width` x `height` characters of two pixels each.

    Returns:
        (2 rows, columns, 3) uint8, with at most `height` rows and `width` columns, and where each begins.
    """
    places = list(picture.panels(scene.shape[1]).values())
    wide = sum(size for _, size in places)
    scale = min(2 * max(height, 1) / (ROWS[1] - ROWS[0]), max(width - 2 * GAP, 3) / wide)
    n_rows = 2 * max(int((ROWS[1] - ROWS[0]) * scale / 2), 1)
    parts: list[npt.NDArray[np.uint8]] = []
    starts: list[int] = []
    for left, size in places:
        starts.append(sum(part.shape[1] for part in parts))
        cut = scene[ROWS[0] : ROWS[1], left : left + size].copy()
        if left == picture.ABOVE_LEFT:  # the phantom is less wide than deep, and below it stands text
            cut[picture.TOP + size - ROWS[0] :] = BACKGROUND
        shape = (max(int(size * scale), 1), n_rows)
        parts += [
            np.asarray(cv2.resize(cut, shape, interpolation=cv2.INTER_AREA), dtype=np.uint8),
            np.zeros((n_rows, GAP, 3), np.uint8),
        ]
    return np.concatenate(parts[:-1], axis=1), starts


def blocks(image: npt.NDArray[np.uint8], *, colored: bool) -> Text:
    """Return (2 rows, columns, 3) as characters: half blocks in colour, or shades of grey without."""
    text = Text()
    for upper, lower in zip(image[0::2], image[1::2], strict=True):
        for above, below in zip(upper.tolist(), lower.tolist(), strict=True):
            if colored:
                style = Style(color=Color.from_rgb(*above), bgcolor=Color.from_rgb(*below))
                text.append("▀", style=style)
            else:
                brightness = ((sum(above) + sum(below)) / (6 * 256)) ** 0.6
                text.append(SHADES[int(brightness * len(SHADES))])
        text.append("\n")
    return text


def _live(watched: Watched, episode: dict[str, Any], console: Console) -> None:
    names = replay.action_names(watched.config.task)
    console.print(title(watched, episode), highlight=False)
    with Live(console=console, auto_refresh=False) as live:
        for moment in _moments(watched, episode):
            live.update(screen(moment, len(episode["actions"]), names, console), refresh=True)
            time.sleep(film.STEP_MS / 1000)


def _moments(watched: Watched, episode: dict[str, Any]) -> Iterator[Moment]:
    config, adviser = watched.config, watched.adviser
    if adviser is not None:
        adviser.begin()
    setting = Setting.recorded(config)
    return replay.play(setting, int(episode["eval_episode"]), episode["actions"], adviser=adviser)
