"""The figures and the table of widths of docs/physics.md: `make figures`.

The widths are compared with those of an independent code (esdiva 0.3.0, the Field II method), which are in
tests/reference.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table

from usbench.envs.phantom import Phantom
from usbench.envs.pose import Pose
from usbench.envs.probe import DEFAULT_ARRAY
from usbench.envs.rf import FEW_PAIRS, simulate_iq
from usbench.envs.scanner import scan

DOCS = Path(__file__).parents[1] / "docs"
REFERENCE = Path(__file__).parents[1] / "tests" / "reference" / "rf_reference.npz"
DEPTHS = (20e-3, 35e-3, 50e-3, 70e-3)
OFFSETS = np.arange(101) * 1e-4
Floats = npt.NDArray[np.float64]


def point(x: float, depth: float, focal_depth: float, lines: npt.ArrayLike) -> tuple[Floats, Floats]:
    """Return envelope and time of a point; silent points beside it have it summed with the table."""
    n = FEW_PAIRS + 1
    iq, time = simulate_iq([(x, 0.0, depth)] * n, np.arange(n) == 0, DEFAULT_ARRAY, focal_depth, lines)
    return np.abs(iq), time


def profile(focal_depth: float, depth: float) -> Floats:
    """Return how loud the line at x = 0 hears a point at `depth` m and at OFFSETS beside it, (n_offsets,)."""
    return np.array([point(x, depth, focal_depth, [0.0])[0].max() for x in OFFSETS])


def width(values: Floats, level_db: float) -> str:
    """Return the full width of a symmetrical profile, out to where it last reaches `level_db`, in words."""
    level = values.max() * 10 ** (level_db / 20)
    last = np.flatnonzero(values >= level)[-1]
    if last == len(OFFSETS) - 1:
        return f"over {2e3 * OFFSETS[-1]:.0f} mm"
    return f"{2e3 * np.interp(-level, -values[last : last + 2], OFFSETS[last : last + 2]):.2f} mm"


def decibels(values: Floats) -> Floats:
    """Return 20 log10 relative to the maximum, from -80 dB."""
    return np.asarray(20 * np.log10(np.maximum(values / values.max(), 1e-4)))


def references() -> dict[tuple[float, float], Floats]:
    """Return the reference's profiles by focal depth and depth."""
    with np.load(REFERENCE) as data:
        return {
            (focus, depth): data["psf_lateral"][i, k].astype(np.float64)
            for i, focus in enumerate((50e-3, 20e-3))
            for k, depth in enumerate(DEPTHS)
        }


def widths(theirs: dict[tuple[float, float], Floats]) -> Table:
    """Return the widths of a point at several depths as a table."""
    table = Table(
        "focus", "depth", "-6 dB", "-6 dB, esdiva", "-20 dB", "-20 dB, esdiva", title="Width of a point"
    )
    for focus in (50e-3, 20e-3):
        for depth in DEPTHS:
            ours, other = profile(focus, depth), theirs[focus, depth]
            row = [f"{focus * 1e3:.0f} mm", f"{depth * 1e3:.0f} mm"]
            for level in (-6.0, -20.0):
                row += [width(ours, level), width(other, level)]
            table.add_row(*row)
    return table


def point_image(axes: Axes, depth: float) -> None:
    """Draw the image of a point at `depth` m with the focus at 50 mm."""
    x = np.arange(-100, 101) * 1e-4
    envelope, time = point(0.0, depth, 50e-3, x)
    z = (time - DEFAULT_ARRAY.pulse_delay) * DEFAULT_ARRAY.speed_of_sound / 2 - depth
    rows = np.abs(z) <= 2.8e-3
    shown = decibels(envelope[rows].astype(np.float64))
    axes.pcolormesh(x * 1e3, z[rows] * 1e3, shown, cmap="gray", vmin=-60, vmax=0, shading="gouraud")
    axes.set(title=f"point at {depth * 1e3:.0f} mm", ylim=(2.5, -2.5))


def point_response(theirs: dict[tuple[float, float], Floats]) -> Figure:
    """Return images of a point at several depths, and its lateral profiles beside the reference's."""
    figure = Figure(figsize=(9.0, 5.3), layout="constrained")
    axes = figure.subplots(2, len(DEPTHS), sharex=True, sharey="row")
    for above, below, depth in zip(*axes, DEPTHS, strict=True):
        point_image(above, depth)
        both = np.concatenate([-OFFSETS[:0:-1], OFFSETS]) * 1e3
        lines = [
            (theirs[50e-3, depth], "esdiva (Field II method)", {"color": "0.72", "linewidth": 4.0}),
            (profile(50e-3, depth), "usbench", {"color": "black", "linewidth": 1.0}),
        ]
        for values, label, style in lines:
            below.plot(both, decibels(np.concatenate([values[:0:-1], values])), label=label, **style)
        below.set(xlim=(-10, 10), ylim=(-60, 2), xlabel="lateral (mm)")
        below.grid(color="0.9")
    axes[0, 0].set_ylabel("depth from the point (mm)")
    axes[1, 0].set_ylabel("peak of the envelope (dB)")
    # Not over the skirts of a curve, where the two differ.
    figure.legend(*axes[1, -1].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


def four_foci() -> Figure:
    """Return the phantom's frame with four focal depths, and the width of a point at each focus."""
    figure = Figure(figsize=(9.0, 4.8), layout="constrained")
    every = figure.subplots(1, len(DEPTHS), sharey=True)
    phantom = Phantom()
    for axes, depth in zip(every, DEPTHS, strict=True):
        frame = scan(phantom, Pose(0, round(depth * 1e3), 0))
        image = axes.imshow(
            frame * (60 / 255) - 60,
            cmap="gray",
            vmin=-60,
            vmax=0,
            extent=(-20, 20, 90, 0),
            interpolation="none",
        )
        axes.axhline(depth * 1e3, color="white", linestyle=":", linewidth=1.0)
        axes.set(
            title=f"focus {depth * 1e3:.0f} mm",
            xlabel=f"lateral (mm)\n\na point at the focus:\n{width(profile(depth, depth), -6.0)} at -6 dB",
        )
    every[0].set_ylabel("depth (mm)")
    figure.colorbar(image, ax=every, label="dB, 0 is the brightest echo", shrink=0.8)
    return figure


def main() -> None:
    """Write the figures and print the table."""
    theirs = references()
    Console(width=110).print(widths(theirs))
    for name, figure in {"point_response": point_response(theirs), "four_foci": four_foci()}.items():
        path = DOCS / f"{name}.png"
        figure.savefig(path, dpi=130, metadata={"Software": None})
        print(path)


if __name__ == "__main__":
    main()
