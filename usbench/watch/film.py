"""Moments of an episode as pages with words below the picture, written as .gif, .webp or .mp4."""

import textwrap
from collections.abc import Iterable, Sequence
from itertools import chain
from pathlib import Path

import cv2
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from usbench.atomic import atomic_file, move_whole, scratch_folder
from usbench.watch.moment import Advice, Moment

FORMATS = (".gif", ".webp", ".mp4")
STEP_MS, LAST_STEP_MS = 450, 2000
# A third of the size of a .gif, and small letters stay clear.
WEBP_QUALITY = 60
# The first is what browsers play, the second what every build of OpenCV writes.
CODECS = ("vp09", "mp4v")
# Pixels; the words below a picture need this width, a picture of narrow frames is less wide.
WIDTH = 1240
WORDS_HEIGHT, LINE_HEIGHT, ACTION_HEIGHT, TEXT_SIZE = 120, 28, 22, 16
MEANING_SIZE, MEANING_COLUMNS = 12, 15
LEFT, ADVICE_LEFT, NAME_LEFT, BAR_LEFT, BAR_WIDTH = 50, 580, 685, 950, 240
# Red, green and blue.
FOOTER, FAINT = (15, 18, 24), (150, 156, 168)
BAR, BEST = (86, 180, 233), (240, 228, 66)


def page(moment: Moment, steps: int, names: Sequence[str], title: str = "") -> Image.Image:
    """Return the picture with words below it: what was done, and what the agent advises."""
    height, width, _ = moment.picture.shape
    words = height + max(WORDS_HEIGHT, ACTION_HEIGHT * len(names) + 10)
    image = Image.new("RGB", (max(width, WIDTH), words + (LINE_HEIGHT if title else 0)), FOOTER)
    image.paste(Image.fromarray(moment.picture), (0, 0))
    draw = ImageDraw.Draw(image)
    lines = [f"step {moment.step}/{steps}: {moment.action}", *facts(moment)]
    for number, (line, size) in enumerate(zip(lines, (20, TEXT_SIZE, TEXT_SIZE), strict=True)):
        place = (LEFT, height + 4 + LINE_HEIGHT * number)
        draw.text(place, line, fill="white", font=ImageFont.load_default(size=size))
    draw.text((LEFT, words), title, fill=FAINT, font=ImageFont.load_default(size=TEXT_SIZE))
    if moment.advice is not None:
        _draw_advice(draw, moment.advice, names, height + 2)
    image.info["duration"] = LAST_STEP_MS if moment.step == steps else STEP_MS
    return image


def facts(moment: Moment) -> tuple[str, str]:
    """Return reward, distance and slip in a line, the return beside the optimum and the end in another."""
    reached = "   at the goal" if moment.is_success else ""
    slip = f"   then slipped {moment.slip}" if moment.slip else ""
    return (
        f"reward {fixed(moment.reward)}   distance {moment.distance_mm:g} mm{slip}",
        f"return {fixed(moment.return_)}   optimum in this episode {fixed(moment.optimum)}{reached}",
    )


def fixed(number: float) -> str:
    """Return a number with two digits, never -0.00."""
    return f"{number:z.2f}"


def advice_numbers(advice: Advice) -> list[str]:
    """Return the weight of every action as text; nothing for an agent that tells only its choice."""
    if advice.kind == "choice":
        return [""] * len(advice.weights)
    if advice.kind == "probability":
        return [f"{100 * weight:.0f} %" for weight in advice.weights]
    return [fixed(weight) for weight in advice.weights]


def advice_words(advice: Advice, names: Sequence[str]) -> list[str]:
    """Return the name of every action with its weight."""
    return [f"{name} {number}".rstrip() for name, number in zip(names, advice_numbers(advice), strict=True)]


def write(path: Path, pages: Iterable[Image.Image]) -> None:
    """Write pages of one size as .gif, .webp or .mp4; the last page of an episode stays for longer.

    A video takes them one by one, so that one of many episodes needs no more memory than a short one; Pillow
    holds the whole of a .gif or .webp.

    Raises:
        ValueError: If the name ends otherwise.
        OSError: If OpenCV cannot write the video.
    """
    if path.suffix in (".gif", ".webp"):
        first, *others = pages
        with atomic_file(path) as file:
            first.save(
                file,
                format=path.suffix[1:].upper(),
                save_all=True,
                append_images=others,
                duration=[_duration_ms(page) for page in (first, *others)],
                loop=0,
                quality=WEBP_QUALITY,
            )
    elif path.suffix == ".mp4":
        with scratch_folder(path) as folder:
            video = folder / path.name  # OpenCV knows the container by the ending
            _write_video(video, pages)
            move_whole(video, path)
    else:
        raise ValueError(f"a replay must end with one of {', '.join(FORMATS)}, not {path.name!r}.")


def _draw_advice(draw: ImageDraw.ImageDraw, advice: Advice, names: Sequence[str], top: int) -> None:
    """Draw a bar for every action, the advised one marked by more than its colour."""
    font = ImageFont.load_default(size=TEXT_SIZE)
    words = advice_words(advice, names)
    draw.text((ADVICE_LEFT, top), "advice now:", fill="white", font=font)
    meaning = textwrap.fill(advice.meaning, MEANING_COLUMNS)
    small = ImageFont.load_default(size=MEANING_SIZE)
    draw.multiline_text((ADVICE_LEFT, top + ACTION_HEIGHT), meaning, fill=FAINT, font=small)
    for number, (bar, text) in enumerate(zip(advice.bars, words, strict=True)):
        best = number == advice.best
        y = top + ACTION_HEIGHT * number
        length = round(BAR_WIDTH * bar)
        marked = f"{'> ' if best else '   '}{text}"
        draw.text((NAME_LEFT, y), marked, fill=BEST if best else "white", font=font)
        draw.rectangle((BAR_LEFT, y + 4, BAR_LEFT + length, y + 16), fill=BEST if best else BAR)


def _duration_ms(page: Image.Image) -> int:
    return int(page.info["duration"])


def _write_video(path: Path, pages: Iterable[Image.Image]) -> None:
    rest = iter(pages)
    first = next(rest)
    writer = _open_video(path, first.size)
    try:
        for page in chain((first,), rest):
            for _ in range(round(_duration_ms(page) / STEP_MS)):
                writer.write(cv2.cvtColor(np.asarray(page), cv2.COLOR_RGB2BGR))
    finally:
        writer.release()


def _open_video(path: Path, size: tuple[int, int]) -> cv2.VideoWriter:
    for codec in CODECS:
        writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*codec), 1000 / STEP_MS, size)
        if writer.isOpened():
            return writer
    raise OSError("this build of OpenCV cannot write .mp4: choose .gif or .webp.")
