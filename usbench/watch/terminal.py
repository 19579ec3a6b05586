"""Episodes in the terminal: live, or as a table of text."""

import time
from collections.abc import Iterator, Sequence
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

from usbench.coordinates import BY_NAME, POSE
from usbench.envs.scene import picture
from usbench.envs.scene.drawing import BACKGROUND
from usbench.envs.settings import in_words
from usbench.watch import film
from usbench.watch.moment import Moment
from usbench.watch.selection import Selection

# The rows that the panels of the scene share, with the probe above.
ROWS = (picture.TOP - 40, picture.BOTTOM)
GAP = 2
TEXT_LINES = 8
SHADES = " ░▒▓█"


def show(selection: Selection, console: Console | None = None) -> None:
    """Play the episodes in the terminal, or print them as tables where the output is no terminal."""
    console = console or Console()
    for episode in selection.episodes:
        if console.is_terminal:
            _live(selection, episode, console)
        else:
            print(selection.title(episode))
            print(table(selection.moments(episode), selection.names))


def table(moments: Iterator[Moment], names: Sequence[str]) -> str:
    """Return an episode as text: a row for the start and for every step."""
    rows = [
        {
            "step": moment.step,
            "action": moment.action,
            "reward": film.fixed(moment.reward),
            "return": film.fixed(moment.return_),
            "optimum": film.fixed(moment.optimum),
            **{_heading(name): getattr(moment.pose, name) for name in POSE},
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
    """Return what the terminal shows of a moment: scene beside frame, and words below."""
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
    where = [BY_NAME[name].value.format(getattr(pose, name)) for name in POSE]
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


def _heading(coordinate: str) -> str:
    """Return the heading of a column of coordinates, "focal depth (mm)" for `focal_depth_mm`."""
    words, _, unit = coordinate.rpartition("_")
    return f"{words.replace('_', ' ')} ({unit})"


def _live(selection: Selection, episode: dict[str, Any], console: Console) -> None:
    console.print(selection.title(episode), highlight=False)
    with Live(console=console, auto_refresh=False) as live:
        for moment in selection.moments(episode):
            shown = screen(moment, len(episode["actions"]), selection.names, console)
            live.update(shown, refresh=True)
            time.sleep(film.STEP_MS / 1000)
