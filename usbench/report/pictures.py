"""Figures and films as texts that stand in a page: vector graphics where they are small, else pixels."""

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure
from PIL import Image

from usbench.figures import comparison, style
from usbench.results.tables import Results

# Bytes; a figure of more lines than this is smaller as pixels.
SVG_LIMIT = 60_000
CSS_PIXELS_PER_INCH = 96
# Of WebP, with few whole pictures in a film: a third of the size of a GIF and no worse to look at.
QUALITY = 40
FEW_KEYS = {"kmin": 30, "kmax": 60}


@dataclass(frozen=True)
class Picture:
    """What an `img` element needs: its data as a URI, and the size at which it is shown, in CSS pixels."""

    src: str
    width: int
    height: int


def compared(known: Results) -> dict[str, Picture | None]:
    """Return the figures of a comparison by name, None where there are no results for one."""
    return {name: from_figure(figure) if figure else None for name, figure in comparison.draw(known).items()}


def from_figure(figure: Figure) -> Picture:
    """Return a figure as SVG, or as PNG where that is smaller than many lines."""
    width, height = (round(CSS_PIXELS_PER_INCH * inches) for inches in figure.get_size_inches())
    with TemporaryDirectory() as folder:
        data = style.save(figure, Path(folder) / "figure.svg").read_bytes()
        if len(data) <= SVG_LIMIT:
            return Picture(_uri("image/svg+xml", data), width, height)
        path = style.save(figure, Path(folder) / "figure.png")
        with Image.open(path) as image:
            # A palette is a third of the size, and enough for lines and shades of few colours.
            small = image.convert("RGB").quantize(256, dither=Image.Dither.NONE)
    return Picture(_uri("image/png", _saved(small, "PNG", optimize=True)), width, height)


def from_frame(frame: npt.NDArray[np.uint8]) -> Picture:
    """Return a B-mode frame (height, width, 1) as PNG, two CSS pixels per mm."""
    image = Image.fromarray(frame[:, :, 0])
    data = _saved(image, "PNG", optimize=True)
    return Picture(_uri("image/png", data), 2 * image.width, 2 * image.height)


def from_pages(pages: Sequence[Image.Image]) -> tuple[Picture, Picture]:
    """Return pages of one size as an animation (WebP), and the last of them as a still."""
    film = _saved(
        pages[0],
        "WEBP",
        save_all=True,
        append_images=pages[1:],
        duration=[int(page.info["duration"]) for page in pages],
        loop=0,
        quality=QUALITY,
        **FEW_KEYS,
    )
    still = _saved(pages[-1], "WEBP", quality=QUALITY)
    size = pages[0].size
    return Picture(_uri("image/webp", film), *size), Picture(_uri("image/webp", still), *size)


def _saved(image: Image.Image, kind: str, **settings: Any) -> bytes:
    buffer = io.BytesIO()
    image.save(buffer, format=kind, **settings)
    return buffer.getvalue()


def _uri(kind: str, data: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(data).decode()}"
