"""How hard each row is to tune: scores of its candidates, and the expected best of n of them."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from usbench.figures import looks, score_axis, style
from usbench.results.protocol import tuning

NAME = "tuning"
# Where the crosses of candidates that diverged stand on the axis of scores.
DIVERGED_AT = 0.015


def write(known: pd.DataFrame, out: Path, formats: Sequence[str] = ("png",), name: str = NAME) -> list[Path]:
    """Draw the figure of a table of `tuning.read` into `out`; return the paths, none without rows."""
    figure = draw(known)
    return [] if figure is None else [style.save(figure, out / f"{name}.{kind}") for kind in formats]


def draw(known: pd.DataFrame) -> Figure | None:
    """Draw each row's candidates, and the expected best of n with its interval; None without any."""
    by_row = tuning.candidates(known)
    if not by_row:
        return None
    drawn = looks.agents(by_row)
    figure, axes = style.panels(1, 2, height=max(1.9, 0.4 + 0.25 * len(by_row)))
    spread, best = axes[0]
    curves = []
    for place, (row, scores) in enumerate(by_row.items()):
        color = drawn[row]["color"]
        diverged = np.isnan(scores)
        counted = np.where(diverged, tuning.DIVERGED, scores)
        low, middle, high = np.percentile(counted, [25, 50, 75])
        bar = [max(low, 0), max(high, 0)]
        spread.plot(bar, [place] * 2, color=color, alpha=0.35, linewidth=7, solid_capstyle="butt")
        spread.plot([max(middle, 0)] * 2, [place - 0.25, place + 0.25], color=color, linewidth=2)
        seen = np.where(diverged, DIVERGED_AT, counted)
        for marker, which in (("o", ~diverged & (counted >= 0)), ("x", diverged)):
            heights = np.full(which.sum(), place)
            spread.plot(seen[which], heights, marker, color="0.2", fillstyle="none", markersize=4)
        score_axis.mark_lowest(spread, place, counted.min(), color)
        expected = tuning.expected(scores)
        n = np.arange(1, len(scores) + 1)
        best.plot(n, expected.estimate, label=row, markersize=3.5, linewidth=1.2, **drawn[row])
        best.fill_between(n, expected.low, expected.high, color=color, alpha=0.1, linewidth=0)
        curves.append((n, expected.estimate, color))
    score_axis.mark_below(best, curves)
    spread.set_yticks(range(len(by_row)), list(by_row))
    spread.set_ylim(len(by_row) - 0.5, -0.5)
    spread.set_xlim(0, score_axis.HIGHEST)
    spread.set_xlabel("score of a candidate in the first rung")
    spread.set_title(
        "circles: candidates; bar: quartiles and median;\nan arrow and a number: the lowest of those below 0",
        fontsize=style.TEXT,
    )
    best.set_ylim(0, score_axis.HIGHEST)
    best.set_xlabel("n candidates drawn at random")
    best.set_ylabel("expected best score")
    best.set_title(
        f"best of n, 95 % bootstrap band up to {tuning.LAST_WITH_INTERVAL};\n"
        "an arrow: a score below 0; a grey square: several",
        fontsize=style.TEXT,
    )
    style.legend(figure, *best.get_legend_handles_labels())
    return figure
