"""What each setting of the task `setup` does to the image: `python benchmarks/imaging_setup.py`.

Prints the contrast-to-noise ratio along each setting through the best combination, beside the generalized
ratio (Rodriguez-Molares et al. 2020, Eq. 9: 1 minus the overlap of both histograms), and the best focus and
range of each frequency. Frames that are not kept yet are simulated.
"""

import argparse
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table

from usbench.envs.bmode import Imaging
from usbench.envs.frames import FrameStore, frame_store
from usbench.envs.pose import Pose
from usbench.envs.probe import LinearArray
from usbench.envs.settings import Setup
from usbench.envs.tasks.imaging_setup import IMAGING_SETUP, PHANTOM, contrast_to_noise, regions
from usbench.figures import style

SETTINGS = {
    "focal_depth_mm": ("focal depth", "mm", 1),
    "frequency_khz": ("centre frequency", "MHz", 1_000),
    "dynamic_range_db": ("dynamic range", "dB", 1),
}
Quality = Mapping[Setup, tuple[float, float]]


def generalized(frame: npt.NDArray[np.uint8]) -> float:
    """Return the generalized contrast-to-noise ratio of a frame, with a bin for every grey level."""
    histograms = [
        np.bincount(frame[mask], minlength=256) / mask.sum() for mask in regions(PHANTOM, Pose(), Imaging())
    ]
    return float(1 - np.minimum(*histograms).sum())


def measure(store: FrameStore) -> Quality:
    """Return the contrast-to-noise ratio and the generalized ratio of every combination of settings."""
    masks = regions(PHANTOM, Pose(), Imaging())
    frames = {pose: store.frame(pose) for pose in IMAGING_SETUP.states if isinstance(pose, Setup)}
    return {pose: (contrast_to_noise(frame, *masks), generalized(frame)) for pose, frame in frames.items()}


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
        for row, kind in enumerate(("contrast-to-noise ratio", "generalized")):
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


def figure(store: FrameStore, quality: Quality, best: Setup) -> Figure:
    """Return a figure with a row for each setting: frames at both ends and the best value, and quality."""
    drawn = Figure(figsize=(10.5, 9.6), dpi=110, layout="constrained")
    axes = drawn.subplots(len(SETTINGS), 4, width_ratios=(1, 1, 1, 2.2), squeeze=False)
    for row, (setting, (name, unit, scale)) in zip(axes, SETTINGS.items(), strict=True):
        poses = along(best, setting)
        for axis, pose in zip(row, (poses[0], best, poses[-1]), strict=False):
            axis.imshow(store.frame(pose), cmap="gray", vmin=0, vmax=255, extent=(-20, 20, 90, 0))
            axis.set_title(f"{getattr(pose, setting) / scale:g} {unit}: {quality[pose][0]:.2f}", fontsize=10)
        row[0].set_ylabel(f"{name}\ndepth (mm)")
        values = [getattr(pose, setting) / scale for pose in poses]
        for kind, label in enumerate(("contrast-to-noise ratio", "generalized")):
            look = style.styles(("contrast-to-noise ratio", "generalized"))[label]
            row[3].plot(values, [quality[pose][kind] for pose in poses], label=label, **look)
        row[3].set(xlabel=f"{name} ({unit})", ylim=(0, 2.5))
        row[3].grid(alpha=0.3)
    axes[0, 3].legend(fontsize=9, loc="lower center")
    return drawn


def main() -> None:
    """Print the tables; with --figure, draw frames and curves."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--figure", type=Path, metavar="FILE", help="also draw frames and curves")
    args = parser.parse_args()
    store = frame_store(PHANTOM, LinearArray(), Imaging())
    store.prepare(IMAGING_SETUP.states)
    quality = measure(store)
    best = max(quality, key=lambda pose: quality[pose][0])
    for table in tables(quality, best):
        Console(width=110).print(table)
    if args.figure is not None:
        style.save(figure(store, quality, best), args.figure)
        print(args.figure)


if __name__ == "__main__":
    main()
