"""Episodes in the terminal: live, or as a table of text."""

import io
import itertools
import textwrap
import time
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from rich.color import Color
from rich.console import Console
from rich.live import Live
from rich.style import Style
from rich.table import Table
from rich.text import Text

from usbench.coordinates import BY_NAME, POSE
from usbench.envs.settings import in_words
from usbench.watch import film, panels
from usbench.watch.moment import Moment
from usbench.watch.selection import Selection

TEXT_LINES = 8
SHADES = " ░▒▓█"
# Of a table: in fewer columns, numbers would be lost.
LEAST_WIDTH = 60
# Columns of the table that hold words, which may be folded.
WORDS = ("action", "settings", "slip", "advice for the next")
LONGEST_PART = len("clockwise")
# The colours of a terminal with 256 of them, from number 16: a cube of 6 x 6 x 6, and 24 greys.
FIRST_OF_256 = 16
_CUBE = (0, 95, 135, 175, 215, 255)
PALETTE_256 = np.array(
    [*itertools.product(_CUBE, repeat=3), *([8 + 10 * number] * 3 for number in range(24))], dtype=np.int64
)


def show(selection: Selection, console: Console | None = None) -> None:
    """Play the episodes in the terminal, or print them as tables where the output is no terminal."""
    console = console or Console()
    for episode in selection.episodes:
        if console.is_terminal:
            _live(selection, episode, console)
        else:
            print(textwrap.fill(selection.title(episode), console.width), file=console.file)
            print(table(selection.moments(episode), selection.names, console.width), file=console.file)


def table(moments: Iterable[Moment], names: Sequence[str], width: int = 80) -> str:
    """Return an episode as text of `width` columns, `LEAST_WIDTH` at least: a row for start and every step.

    Words are folded, numbers are not. A coordinate that stays as it is, and slips where there are none, have
    no column. A line below says what the numbers of the advice are.
    """
    played = list(moments)
    width = max(width, LEAST_WIDTH)
    columns = _folded(_columns(played, names), width)
    table = Table(box=None, padding=(0, 0, 0, 1), pad_edge=False)
    for heading, texts in columns.items():
        words = heading in WORDS
        table.add_column(
            heading,
            justify="left" if words else "right",
            no_wrap=not words,
            min_width=max(len(line) for text in texts for line in text.split("\n")),
        )
    for row in zip(*columns.values(), strict=True):
        table.add_row(*row)
    console = Console(width=width, color_system=None, file=io.StringIO(), force_terminal=False)
    console.print(table)
    assert isinstance(console.file, io.StringIO)
    lines = [line.rstrip() for line in console.file.getvalue().splitlines()]
    return "\n".join([*lines, *_meaning(played, width)])


def _meaning(played: Sequence[Moment], width: int) -> list[str]:
    """Return the lines that say what the numbers of the advice are, none where no advice has numbers."""
    advised = next((moment.advice for moment in played if moment.advice is not None), None)
    if advised is None or advised.kind == "choice":
        return []
    return textwrap.wrap(f"advice for the next: {advised.meaning}", width)


def _columns(played: Sequence[Moment], names: Sequence[str]) -> dict[str, list[str]]:
    """Return the texts of the table's columns by their headings."""
    poses = [moment.pose for moment in played]
    moving = [name for name in POSE if name == POSE[0] or len({getattr(pose, name) for pose in poses}) > 1]
    advised = [
        "" if advice is None else f"{film.advice_numbers(advice)[advice.best]} {names[advice.best]}".strip()
        for advice in (moment.advice for moment in played)
    ]
    columns = {
        "step": [str(moment.step) for moment in played],
        "action": [moment.action for moment in played],
        "reward": [film.fixed(moment.reward) for moment in played],
        "return": [film.fixed(moment.return_) for moment in played],
        "optimum": [film.fixed(moment.optimum) for moment in played],
        **{_heading(name): [str(getattr(pose, name)) for pose in poses] for name in moving},
        "settings": [", ".join(in_words(pose)) for pose in poses],
        "to\ngo\nmm": [f"{moment.distance_mm:g}" for moment in played],
        "slip": [moment.slip for moment in played],
        "advice for the next": advised,
    }
    return {heading: texts for heading, texts in columns.items() if heading not in WORDS or any(texts)}


def _folded(columns: Mapping[str, list[str]], width: int) -> dict[str, list[str]]:
    """Return the columns with words folded, at their hyphens too, into the room that the numbers leave."""
    words = [heading for heading in columns if heading in WORDS]
    numbers = [
        max(map(len, [*heading.split("\n"), *texts])) + 1
        for heading, texts in columns.items()
        if heading not in words
    ]
    room = max((width - sum(numbers)) // len(words) - 1, LONGEST_PART)
    return {
        heading: [textwrap.fill(text, room) for text in texts] if heading in words else texts
        for heading, texts in columns.items()
    }


def screen(moment: Moment, steps: int, names: Sequence[str], console: Console) -> Text:
    """Return what the terminal shows of a moment: scene beside frame, and words below."""
    width, height = console.size
    # A character has two pixels, one above the other.
    image, starts = panels.side_by_side(moment.picture, max(width, 7), 2 * max(height - TEXT_LINES, 1))
    text = Text()
    heads = " " * width
    for name, start in starts.items():
        heads = heads[:start] + name + heads[start + len(name) :]
    text.append(heads[:width].rstrip() + "\n", style="bold")
    text.append_text(blocks(image, console.color_system))
    pose = moment.pose
    text.append(f"step {moment.step}/{steps}: {moment.action}", style="bold")
    where = [BY_NAME[name].value.format(getattr(pose, name)) for name in POSE]
    text.append("".join(f"   {part}" for part in [*where, *in_words(pose)]) + "\n")
    text.append("\n".join(film.facts(moment)) + "\n")
    if moment.advice is not None:
        text.append(f"advice ({moment.advice.meaning}): ")
        for number, words in enumerate(film.advice_words(moment.advice, names)):
            best = number == moment.advice.best
            text.append(f"[{words}]" if best else words, style="bold" if best else "")
            text.append("  ")
    return text


def blocks(image: npt.NDArray[np.uint8], color_system: str | None) -> Text:
    """Return (2 rows, columns, 3) as characters: half blocks in colour, or shades of grey.

    Args:
        image: Red, green and blue.
        color_system: "truecolor", "256", or anything else for a terminal of few colours or none.
    """
    text = Text()
    colors = _colors(image, color_system)
    for row, (upper, lower) in enumerate(zip(image[0::2], image[1::2], strict=True)):
        for column, (above, below) in enumerate(zip(upper.tolist(), lower.tolist(), strict=True)):
            if colors:
                style = Style(color=colors[2 * row][column], bgcolor=colors[2 * row + 1][column])
                text.append("▀", style=style)
            else:
                brightness = ((sum(above) + sum(below)) / (6 * 256)) ** 0.6
                text.append(SHADES[int(brightness * len(SHADES))])
        text.append("\n")
    return text


def _colors(image: npt.NDArray[np.uint8], color_system: str | None) -> list[list[Color]]:
    """Return the colour of every pixel in a terminal of that system, nothing where it has too few."""
    if color_system == "truecolor":
        return [[Color.from_rgb(*pixel) for pixel in row] for row in image.tolist()]
    if color_system != "256":
        return []
    # The nearest of all 240: rich looks in the cube alone for what is hardly coloured, and dark blue is loud.
    shown, inverse = np.unique(image.reshape(-1, 3), axis=0, return_inverse=True)
    distance = ((shown[:, np.newaxis].astype(np.int64) - PALETTE_256) ** 2).sum(axis=2)
    numbers = distance.argmin(axis=1)[inverse].reshape(image.shape[:2]) + FIRST_OF_256
    return [[Color.from_ansi(number) for number in row] for row in numbers.tolist()]


def _heading(coordinate: str) -> str:
    """Return the heading of a column of coordinates: the words of `focal_depth_mm` one above the other."""
    return coordinate.replace("_", "\n")


def _live(selection: Selection, episode: dict[str, Any], console: Console) -> None:
    console.print(selection.title(episode), highlight=False)
    with Live(console=console, auto_refresh=False) as live:
        for moment in selection.moments(episode):
            shown = screen(moment, len(episode["actions"]), selection.names, console)
            live.update(shown, refresh=True)
            time.sleep(film.STEP_MS / 1000)
