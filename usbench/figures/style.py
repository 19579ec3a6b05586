"""How figures look and how they are saved: the same bytes from the same numbers, readable in grey."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.figure import Figure

from usbench.atomic import atomic_file
from usbench.records import ConfigurationError

FORMATS = ("png", "svg", "pdf")
# Okabe and Ito's palette without its yellow: told apart by colour-blind readers, on white.
COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#000000")
LINES: tuple[Any, ...] = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (8, 2)), (0, (1, 2, 4, 2)))
# Inches that a line with its marker takes, and a letter of its label.
LEGEND_HANDLE, LEGEND_LETTER = 0.62, 0.085
# Two more than colours, so that the eighth agent is not drawn as the first.
MARKERS = ("o", "s", "D", "^", "v", "P", "X", "<", ">")


def styles(names: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Return how each name is drawn: colour, line and marker all differ, so that a grey print can be read."""
    keys = sorted(set(names))
    return {
        name: {
            "color": COLORS[number % len(COLORS)],
            "linestyle": LINES[number % len(LINES)],
            "marker": MARKERS[number % len(MARKERS)],
        }
        for number, name in enumerate(keys)
    }


def panels(
    rows: int, columns: int, *, width: float = 3.6, height: float = 2.6, **kwargs: Any
) -> tuple[Figure, Any]:
    """Return a figure and its axes `(rows, columns)`, each panel `width` x `height` inches."""
    figure = Figure(figsize=(width * columns + 0.6, height * rows + 0.9), dpi=150, layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, **kwargs)
    for panel in axes.flat:
        panel.grid(alpha=0.3)
    return figure, axes


def legend(figure: Figure, handles: Sequence[Any], labels: Sequence[str]) -> None:
    """Draw one legend for all panels, below them, in as many columns as fit."""
    longest = max(map(len, labels), default=0)
    fitting = int(figure.get_figwidth() / (LEGEND_HANDLE + LEGEND_LETTER * longest))
    ncols = max(min(len(labels), fitting, 5), 1)
    figure.legend(handles, labels, loc="outside lower center", ncols=ncols, fontsize=9)


def check_file(path: Path, endings: Sequence[str]) -> Path:
    """Return `path` if a file with one of `endings` can be written there.

    Raises:
        ConfigurationError: If it has another ending, or its folder does not exist.
    """
    if path.suffix not in endings:
        raise ConfigurationError(f"the file must end with one of {', '.join(endings)}, not {path.name!r}.")
    if not path.parent.is_dir() or path.is_dir():
        raise ConfigurationError(f"the file must be in a folder that exists, not {str(path)!r}.")
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
