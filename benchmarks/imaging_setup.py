"""What each setting of the task `setup` does to the image: `python benchmarks/imaging_setup.py`.

Prints the measures of quality along each setting through the best combination, the best focus and range of
each frequency, how deep each frequency reaches, and what the noise of the electronics and the time gain
compensation do to the optimum: neither of them is the first version of the task, both are the latest. Frames
that are not kept yet are simulated.
"""

import argparse
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table

from usbench.envs.bmode import Imaging
from usbench.envs.frames import FrameStore, frame_store
from usbench.envs.pose import Pose
from usbench.envs.probe import LinearArray
from usbench.envs.scanner import acquire
from usbench.envs.settings import Setup, tuned
from usbench.envs.tasks.image_quality import (
    contrast_order,
    contrast_to_noise,
    generalized_contrast_to_noise,
)
from usbench.envs.tasks.imaging_setup import IMAGING, IMAGING_SETUP, PHANTOM, regions
from usbench.figures import style

SETTINGS = {
    "focal_depth_mm": ("focal depth", "mm", 1),
    "frequency_khz": ("centre frequency", "MHz", 1_000),
    "dynamic_range_db": ("dynamic range", "dB", 1),
}
MEASURES = {
    "contrast-to-noise ratio": contrast_to_noise,
    "generalized": generalized_contrast_to_noise,
    "contrast order": contrast_order,
}
RECEIVERS = {
    "neither (v0)": Imaging(),
    "gain alone": replace(IMAGING, noise_db=None),
    "noise alone": replace(IMAGING, tgc_db_per_cm=0.0),
    "both (v1)": IMAGING,
}
# Of each combination of settings, the MEASURES of its frame.
Quality = Mapping[Setup, tuple[float, ...]]


def measure(store: FrameStore) -> Quality:
    """Return the measures of quality of every combination of settings."""
    masks = regions(PHANTOM, Pose(), Imaging())
    store.prepare(IMAGING_SETUP.states)
    frames = {pose: store.frame(pose) for pose in IMAGING_SETUP.states if isinstance(pose, Setup)}
    return {pose: tuple(one(frame, *masks) for one in MEASURES.values()) for pose, frame in frames.items()}


def best_of(quality: Quality) -> Setup:
    """Return the combination of settings with the largest contrast-to-noise ratio."""
    return max(quality, key=lambda pose: quality[pose][0])


def along(best: Setup, setting: str) -> list[Setup]:
    """Return the combinations that differ from `best` in `setting` alone, in ascending order."""
    values = sorted({getattr(pose, setting) for pose in IMAGING_SETUP.states})
    return [replace(best, **{setting: value}) for value in values]


def tables(quality: Quality, best: Setup) -> list[Table]:
    """Return a table for each setting, and a table of the best combination for each frequency."""
    made = []
    for setting, (name, unit, scale) in SETTINGS.items():
        poses = along(best, setting)
        table = Table("", *(f"{getattr(pose, setting) / scale:g} {unit}" for pose in poses), title=name)
        for row, kind in enumerate(MEASURES):
            table.add_row(kind, *(f"{quality[pose][row]:.2f}" for pose in poses))
        made.append(table)
    table = Table("frequency", "best focus", "best range", "contrast-to-noise ratio", title="each frequency")
    for pose in along(best, "frequency_khz"):
        one = max(
            (other for other in quality if other.frequency_khz == pose.frequency_khz),
            key=lambda other: quality[other][0],
        )
        cells = [
            f"{getattr(one, setting) / scale:g} {unit}"
            for setting, (_, unit, scale) in SETTINGS.items()
            if setting != "frequency_khz"
        ]
        table.add_row(f"{pose.frequency_khz / 1e3:g} MHz", *cells, f"{quality[one][0]:.2f}")
    return [*made, table]


def receivers(qualities: Mapping[str, Quality]) -> Table:
    """Return a table of the optimum with each receiver, and of the best there is at each end."""
    columns = ("focus", "frequency", "range", "ratio", "gCNR", "order", "ratio, 80 mm", "ratio, 5 MHz")
    table = Table("noise and gain", *columns, title="the optimum with each receiver")
    for name, quality in qualities.items():
        best = best_of(quality)
        cells = [f"{getattr(best, key) / scale:g} {unit}" for key, (_, unit, scale) in SETTINGS.items()]
        deepest, highest = (
            max(values[0] for pose, values in quality.items() if getattr(pose, key) == end)
            for key, end in (("focal_depth_mm", 80), ("frequency_khz", 5_000))
        )
        numbers = (*quality[best], deepest, highest)
        table.add_row(name, *cells, *(f"{number:.2f}" for number in numbers))
    return table


def reach(focal_depth_mm: int = 50) -> Table:
    """Return a table of the depth at which the echoes of tissue sink below the noise, for each frequency."""
    table = Table("", title=f"where tissue is as loud as the noise, focus {focal_depth_mm} mm")
    cells = []
    for khz in sorted({getattr(pose, "frequency_khz", 0) for pose in IMAGING_SETUP.states}):
        pose = Setup(0, focal_depth_mm, 0, frequency_khz=khz)
        quiet, noisy = (
            acquire(PHANTOM, pose, LinearArray(), replace(IMAGING, noise_db=level, height_px=90))
            for level in (None, IMAGING.noise_db)
        )
        array = tuned(pose, LinearArray(), IMAGING)[1]
        depths_mm = (
            (np.arange(len(quiet)) / array.iq_sampling_frequency - array.pulse_delay)
            * array.speed_of_sound / 2 * 1e3
        )  # fmt: skip
        beside = np.abs(array.line_positions) > 15e-3  # of the cyst
        echoes, noise = (np.square(np.abs(one[:, beside])).mean(axis=1) for one in (quiet, noisy - quiet))
        smooth = np.convolve(echoes, np.ones(40) / 40, mode="same")
        louder = depths_mm[(smooth > noise.mean()) & (depths_mm < 90)]
        table.add_column(f"{khz / 1e3:g} MHz")
        cells.append(f"{louder.max():.0f} mm" if louder.max() < 88 else "deeper than the image")
    table.add_row("depth", *cells)
    return table


# Of the first two measures, which are drawn: label and look.
DRAWN = {
    "contrast-to-noise ratio": {"color": "#0072b2", "linestyle": "-", "marker": "o"},
    "generalized contrast-to-noise ratio": {"color": "#d55e00", "linestyle": "--", "marker": "s"},
}


def figure(store: FrameStore, quality: Quality, best: Setup) -> Figure:
    """Return a figure with a row for each setting: frames at both ends and the best value, and quality."""
    drawn = Figure(figsize=(10.5, 9.6), dpi=110, layout="constrained")
    axes = drawn.subplots(len(SETTINGS), 4, width_ratios=(1, 1, 1, 2.2), squeeze=False)
    for row, (setting, (name, unit, scale)) in zip(axes, SETTINGS.items(), strict=True):
        poses = along(best, setting)
        for axis, pose in zip(row, (poses[0], best, poses[-1]), strict=False):
            axis.imshow(store.frame(pose), cmap="gray", vmin=0, vmax=255, extent=(-20, 20, 90, 0))
            axis.set_title(
                f"{name} {getattr(pose, setting) / scale:g} {unit}\n"
                f"contrast-to-noise ratio {quality[pose][0]:.2f}",
                fontsize=9,
            )
            axis.set_xlabel("lateral (mm)")
        row[0].set_ylabel("depth (mm)")
        values = [getattr(pose, setting) / scale for pose in poses]
        for kind, (label, look) in enumerate(DRAWN.items()):
            row[3].plot(values, [quality[pose][kind] for pose in poses], label=label, **look)
        row[3].set(xlabel=f"{name} ({unit})", ylabel="quality of the frame", ylim=(0, 2.75))
        row[3].grid(alpha=0.3)
    axes[0, 3].legend(fontsize=9, loc="lower center")
    return drawn


def main() -> None:
    """Print the tables; with --figure, draw frames and curves."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--figure", type=Path, metavar="FILE", help="also draw frames and curves")
    args = parser.parse_args()
    stores = {name: frame_store(PHANTOM, LinearArray(), imaging) for name, imaging in RECEIVERS.items()}
    qualities = {name: measure(store) for name, store in stores.items()}
    store, quality = list(stores.values())[-1], list(qualities.values())[-1]
    best = best_of(quality)
    for table in (*tables(quality, best), receivers(qualities), reach()):
        Console(width=110).print(table)
    if args.figure is not None:
        style.save(figure(store, quality, best), args.figure)
        print(args.figure)


if __name__ == "__main__":
    main()
