"""A snapshot as a figure: a frame or an envelope to scale, or RF stretched over depth."""

import textwrap
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.colors import Normalize, SymLogNorm
from matplotlib.figure import Figure

from usbench.envs.settings import in_words, tuned
from usbench.watch.snapshot import SLICE, Snapshot

# RF is shown on a logarithmic scale: the object hides all tissue otherwise.
RF_LINEAR = 0.01
# Inches: what stands beside and above a picture to scale, and the most that the picture itself takes.
BESIDE, ABOVE, WIDEST, HIGHEST = 2.5, 1.375, 7.5, 5.625
# Tall enough that no period of RF falls between two pixels.
RF_SIZE = 5.6, 14.0


def figure(taken: Snapshot) -> Figure:
    """Draw a frame or an envelope to scale, or RF stretched over depth, with axes and units."""
    values, norm, label = _shades(taken)
    right, (top, bottom), pose = taken.half_width, taken.rows, taken.pose
    to_scale = taken.kind != "rf"
    scale = min(WIDEST / (2 * right), HIGHEST / (bottom - top))  # inches per mm
    size = BESIDE + 2 * right * scale, ABOVE + (bottom - top) * scale
    drawn = Figure(figsize=size if to_scale else RF_SIZE, dpi=150, layout="constrained")
    axes = drawn.add_subplot()
    shown = axes.imshow(
        values,
        cmap="gray",
        norm=norm,
        extent=(-right, right, bottom, top),
        aspect="equal" if to_scale else "auto",
    )
    drawn.colorbar(shown, ax=axes, label=label, shrink=0.6, pad=0.05 if to_scale else 0.2)
    axes.set_xlabel("lateral position (mm)")
    axes.set_ylabel("depth (mm)")
    if not to_scale:
        _add_time(axes, taken)
    if to_scale and pose.focal_depth_mm <= bottom and taken.kind != SLICE:
        axes.annotate(
            "◀ focus", (right, pose.focal_depth_mm), xytext=(2, 0), textcoords="offset points",
            color="#d55e00", fontsize=9, va="center", annotation_clip=False,
        )  # fmt: skip
    axes.set_title(_title(taken), fontsize=10, parse_math=False)
    return drawn


def _add_time(axes: Axes, taken: Snapshot) -> None:
    """Add an axis at the right: time from the pulse's start, when echoes of these depths have its middle."""
    _, probe, _ = tuned(taken.pose, taken.source.probe, taken.source.imaging)
    delay_us, mm_per_us = 1e6 * probe.pulse_delay, probe.speed_of_sound * 1e-3 / 2

    def time_us(mm: Any) -> Any:
        return mm / mm_per_us + delay_us

    def depth_mm(us: Any) -> Any:
        return (us - delay_us) * mm_per_us

    axes.secondary_yaxis("right", functions=(time_us, depth_mm)).set_ylabel("time (µs)")


def _title(taken: Snapshot) -> str:
    """Return what is shown, of what and from where, and what differs from the default probe and imaging."""
    kind = {"frame": "B-mode frame", SLICE: "Slice", "envelope": "Envelope", "rf": "RF"}[taken.kind]
    pose, source = taken.pose, taken.source
    focus = [] if taken.kind == SLICE else [f"focus {pose.focal_depth_mm} mm"]
    where = [f"x {pose.x_mm} mm", *focus, f"angle {pose.angle_deg}°", *in_words(pose)]
    changes = textwrap.wrap(", ".join(source.changes), 50)
    return "\n".join([f"{kind}{source.label and f', {source.label}'}", ", ".join(where), *changes])


def _shades(taken: Snapshot) -> tuple[npt.NDArray[Any], Normalize, str]:
    """Return the values to show, how they become shades of grey, and what they are."""
    range_db = taken.range_db
    if taken.kind == "frame":
        decibels = taken.values / 255 * range_db - range_db
        return decibels, Normalize(-range_db, 0.0), "dB relative to the frame's maximum"
    if taken.kind == SLICE:
        return taken.values, Normalize(0, 255), "grey level"
    # Silence, where the probe sees no scatterer, is divided by 1.
    relative = taken.values / (float(np.abs(taken.values).max(initial=0.0)) or 1.0)
    if taken.kind == "rf":
        norm = SymLogNorm(RF_LINEAR, vmin=-1.0, vmax=1.0)
        return relative, norm, f"amplitude relative to the largest, linear within ±{RF_LINEAR:g}"
    decibels = 20 * np.log10(np.maximum(relative, 10 ** (-range_db / 20)))
    return decibels, Normalize(-range_db, 0.0), "dB relative to the envelope's maximum"
