"""A snapshot from one pose: the B-mode frame, the envelope or the RF, as a picture or as numbers."""

import textwrap
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.colors import Normalize, SymLogNorm
from matplotlib.figure import Figure
from PIL import Image

from usbench.atomic import atomic_file
from usbench.envs.bmode import envelope
from usbench.envs.frames import frame_store
from usbench.envs.pose import Pose
from usbench.envs.rf import simulate_iq, simulate_rf
from usbench.envs.scanner import view
from usbench.envs.settings import in_words, tuned
from usbench.figures import style
from usbench.records import ConfigurationError
from usbench.watch.snapshot_option import Source

KINDS = ("frame", "envelope", "rf")
# A frame that was not simulated.
SLICE = "slice"
FORMATS = (".png", ".npy")
# RF is shown on a logarithmic scale: the object hides all tissue otherwise.
RF_LINEAR = 0.01
# Inches: what stands beside and above a picture to scale, and the most that the picture itself takes.
BESIDE, ABOVE, WIDEST, HIGHEST = 2.5, 1.375, 7.5, 5.625
# Tall enough that no period of RF falls between two pixels.
RF_SIZE = 5.6, 14.0


@dataclass(frozen=True)
class Snapshot:
    """What the probe sees from a pose.

    Attributes:
        kind: One of KINDS, or SLICE.
        source: What is examined, and with what.
        pose: Pose of the probe.
        values: (height_px, width_px) uint8 of a frame, else (n_samples, n_lines) float32.
        rows: Where the first row begins and the last one ends: depth in mm, of RF time in us.
        unit: Unit of `values`, in words.
    """

    kind: str
    source: Source
    pose: Pose
    values: npt.NDArray[Any]
    rows: tuple[float, float]
    unit: str

    @property
    def range_db(self) -> float:
        """The dynamic range that a frame has, and with which an envelope is shown."""
        return tuned(self.pose, self.source.probe, self.source.imaging)[2].dynamic_range_db

    @property
    def half_width(self) -> float:
        """Distance (mm) from the middle to the outer edge of the first and the last column."""
        is_frame = self.kind in ("frame", SLICE)
        return 1e3 * (self.source.imaging.width if is_frame else self.source.probe.width) / 2


def path(out: Path | None, kind: str, source: Source, pose: Pose, *, plain: bool = False) -> Path:
    """Return the file to write, named after source and pose unless `out` says its name.

    Raises:
        ConfigurationError: If its ending is not one of FORMATS, its folder does not exist, or `plain`, which
            is for the pixels of a frame, is asked of something else.
    """
    if out is None:
        where = f"x{pose.x_mm}_depth{pose.focal_depth_mm}_angle{pose.angle_deg}"
        settings = [word.replace(" ", "") for word in in_words(pose)]
        out = Path("_".join([kind, *source.names, where, *settings]) + ".png")
    style.check_file(out, FORMATS)
    if plain and (kind != "frame" or out.suffix != ".png"):
        raise ConfigurationError("only a frame as .png has bare pixels: everything else has none to show.")
    return out


def take(source: Source, pose: Pose, kind: str = "frame") -> Snapshot:
    """Simulate what is seen of a source from a pose, or take the frame that is kept.

    Raises:
        ConfigurationError: If RF, envelope or settings of a recorded image are asked for.
    """
    tissue = source.tissue
    if not tissue.has_focus and (kind != "frame" or in_words(pose)):
        asked = kind if kind != "frame" else "settings of a scanner"
        raise ConfigurationError(f"a recorded image has no {asked}: leave it out, or simulate it.")
    plain, probe, imaging = tuned(pose, source.probe, source.imaging)
    if kind == "frame":
        frame = frame_store(tissue, source.probe, source.imaging).frame(pose)
        rows = (0.0, imaging.depth * 1e3)
        if not tissue.has_focus:
            return Snapshot(SLICE, source, pose, frame, rows, "255 for the image's largest voxel")
        unit = f"0 to 255 for the {imaging.dynamic_range_db:g} dB up to the frame's maximum"
        return Snapshot(kind, source, pose, frame, rows, unit)
    positions, amplitudes = tissue.in_view(plain, *view(probe, imaging))
    scene = (positions, amplitudes, probe, pose.focal_depth_mm * 1e-3)
    attenuation = tissue.attenuation_db_per_cm_mhz
    if kind == "rf":
        rf, time = simulate_rf(*scene, attenuation_db_per_cm_mhz=attenuation)
        unit = f"arbitrary units, {probe.rf_sampling_frequency / 1e6:g} MHz from time 0"
        return Snapshot(kind, source, pose, rf, _edges(time * 1e6), unit)
    iq, time = simulate_iq(*scene, max_depth=imaging.depth, attenuation_db_per_cm_mhz=attenuation)
    depths_mm = probe.speed_of_sound * (time - probe.pulse_delay) / 2 * 1e3
    unit = (
        f"arbitrary units, {probe.iq_sampling_frequency / 1e6:g} MHz from time 0 "
        f"(a depth of {depths_mm[0]:.2f} mm)"
    )
    return Snapshot(kind, source, pose, envelope(iq), _edges(depths_mm), unit)


def write(taken: Snapshot, path: Path, *, plain: bool = False) -> None:
    """Write the numbers (.npy), the figure (.png) or, where `plain`, the bare pixels (.png)."""
    if path.suffix == ".npy":
        with atomic_file(path) as file:
            np.save(file, taken.values)
    elif plain:
        with atomic_file(path) as file:
            Image.fromarray(taken.values).save(file, format="PNG")
    else:
        style.save(figure(taken), path)


def figure(taken: Snapshot) -> Figure:
    """Draw a frame or an envelope to scale, or RF over time, with axes and units."""
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
    drawn.colorbar(shown, ax=axes, label=label, shrink=0.6)
    axes.set_xlabel("lateral position (mm)")
    axes.set_ylabel("depth (mm)" if to_scale else "time (µs)")
    if to_scale and pose.focal_depth_mm <= bottom and taken.kind != SLICE:
        axes.annotate(
            "◀ focus", (right, pose.focal_depth_mm), xytext=(2, 0), textcoords="offset points",
            color="#d55e00", fontsize=9, va="center", annotation_clip=False,
        )  # fmt: skip
    axes.set_title(_title(taken), fontsize=10)
    return drawn


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


def _edges(centers: npt.NDArray[np.float64]) -> tuple[float, float]:
    """Return where the first of equally spaced samples begins and the last one ends."""
    half = (centers[1] - centers[0]) / 2
    return float(centers[0] - half), float(centers[-1] + half)
