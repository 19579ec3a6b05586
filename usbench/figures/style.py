"""What all figures share: size, text, legend, and how they are saved: same numbers, same bytes."""

import textwrap
from collections.abc import Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.textpath import TextPath

from usbench.atomic import atomic_file
from usbench.records import ConfigurationError, check_writable

FORMATS = ("png", "svg", "pdf")
# CSS pixels of the column in which pages and hosting sites show a figure, and the inches for which one is
# drawn: a point of text is as large there as it says.
SHOWN_PX = 736
WIDTH = SHOWN_PX / 96
# Points, 9.3 and 10.7 CSS pixels.
SMALL, TEXT = 7, 8
# Inches that a line with its marker takes, beside its label and the room between columns.
LEGEND_HANDLE = 0.75
# How long the line is, in heights of a letter: long enough to show its dashes beside the marker.
LEGEND_LINE = 3.4


def panels(
    rows: int,
    columns: int,
    *,
    width: float | None = None,
    height: float | Sequence[float] = 1.9,
    **kwargs: Any,
) -> tuple[Figure, Any]:
    """Return a figure and its axes `(rows, columns)`.

    Args:
        rows: Of panels.
        columns: Of panels.
        width: Of a panel, in inches; by default all of them fill the width at which figures are shown.
        height: Of the panels in inches, or one for each row.
        **kwargs: As of `Figure.subplots`.
    """
    # NumPy's numbers: from Python 3.12 on, `sum` rounds those of Python otherwise, here and in matplotlib.
    heights = list(np.broadcast_to(np.asarray(height, np.float64), rows))
    wide = WIDTH if width is None else width * columns + 0.6
    with matplotlib.rc_context({"font.size": TEXT}):
        figure = Figure(figsize=(wide, sum(heights) + 0.9), dpi=144, layout="constrained")
        axes = figure.subplots(rows, columns, squeeze=False, height_ratios=heights, **kwargs)
    for panel in axes.flat:
        panel.grid(alpha=0.3)
        panel.tick_params(labelsize=SMALL)
    return figure, axes


def legend(figure: Figure, handles: Sequence[Any], labels: Sequence[str]) -> None:
    """Draw one legend for all panels, below them, in as many columns as fit."""
    longest = max(map(partial(_inches, size=TEXT), labels), default=0.0)
    fitting = int(figure.get_figwidth() / (LEGEND_HANDLE + longest))
    ncols = max(min(len(labels), fitting, 5), 1)
    figure.legend(
        handles, labels, loc="outside lower center", ncols=ncols, fontsize=TEXT, handlelength=LEGEND_LINE
    )


def folded(text: str, inches: float, size: float) -> str:
    """Return a text in lines that are no wider than `inches` in letters of `size` points, as measured."""
    lines = [text]
    for letters in range(len(text), 0, -1):
        lines = textwrap.wrap(text, letters, break_on_hyphens=False)
        if max(map(partial(_inches, size=size), lines), default=0.0) <= inches:
            break
    return "\n".join(lines)


@cache
def _inches(text: str, size: float) -> float:
    return float(TextPath((0, 0), text, size=size).get_extents().width) / 72


def check_file(path: Path, endings: Sequence[str]) -> Path:
    """Return `path` if a file with one of `endings` can be written there.

    Raises:
        ConfigurationError: If it has another ending or is a folder, or its folder does not exist or cannot be
            written.
    """
    if path.suffix not in endings:
        one = "one of " if len(endings) > 1 else ""
        raise ConfigurationError(f"the file must end with {one}{', '.join(endings)}, not {path.name!r}.")
    if path.is_dir():
        raise ConfigurationError(f"the file cannot be {str(path)!r}, which is a folder: choose another name.")
    if not path.parent.is_dir():
        raise ConfigurationError(f"the file must be in a folder that exists, not {str(path)!r}.")
    check_writable(path.parent, "folder")
    return path


def save(figure: Figure, path: Path) -> Path:
    """Write a figure in the format of the name's ending, without dates, and return the path.

    Raises:
        ValueError: If the ending is not one of FORMATS.
    """
    kind = path.suffix.lstrip(".")
    if kind not in FORMATS:
        raise ValueError(f"a figure must end with one of {', '.join(FORMATS)}, not {path.name!r}.")
    metadata = {"png": {"Software": None}, "svg": {"Date": None}, "pdf": {"CreationDate": None}}[kind]
    with (
        # The ids in an SVG are random otherwise.
        matplotlib.rc_context({"svg.hashsalt": "usbench"}),
        atomic_file(path) as file,
    ):
        figure.savefig(file, format=kind, metadata=metadata)
    return path
