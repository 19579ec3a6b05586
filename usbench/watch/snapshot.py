"""One picture from one pose: the B-mode frame, the envelope or the RF, as an image or as numbers."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.colors import Normalize, SymLogNorm
from matplotlib.figure import Figure
from PIL import Image

from usbench.atomic import atomic_file
from usbench.envs.bmode import DEFAULT_IMAGING, envelope
from usbench.envs.frames import frame_store
from usbench.envs.phantom import Phantom
from usbench.envs.pose import Pose
from usbench.envs.probe import DEFAULT_ARRAY
from usbench.envs.rf import simulate_iq, simulate_rf
from usbench.envs.scanner import view
from usbench.envs.settings import in_words, tuned
from usbench.envs.tissue import Tissue
from usbench.figures import style
from usbench.records import ConfigurationError

KINDS = ("frame", "envelope", "rf")
# A frame that was not simulated.
SLICE = "slice"
FORMATS = (".png", ".npy")
# RF is shown on a logarithmic scale: the object hides all tissue otherwise.
RF_LINEAR = 0.01


@dataclass(frozen=True)
class Still:
    """What the probe sees from a pose.

    Attributes:
        kind: One of KINDS, or SLICE.
        pose: Of the probe.
        values: (height_px, width_px) uint8 of a frame, else (n_samples, n_lines) float32.
        rows: Where the first row begins and the last one ends: depth in mm, of RF time in us.
        unit: Of `values`, in words.
        label: Whose phantom it is, "" for that of the paper's tasks.
    """

    kind: str
    pose: Pose
    values: npt.NDArray[Any]
    rows: tuple[float, float]
    unit: str
    label: str = ""

    @property
    def range_db(self) -> float:
        """The dynamic range that a frame has, and an envelope is shown with."""
        return tuned(self.pose, DEFAULT_ARRAY, DEFAULT_IMAGING)[2].dynamic_range_db


def path(out: Path | None, kind: str, pose: Pose, plain: bool = False, label: str = "") -> Path:
    """Return the file to write, named after phantom and pose unless `out` says its name.

    Raises:
        ConfigurationError: If its ending is not one of FORMATS, its folder does not exist, or `plain`, which
            is for the pixels of a frame, is asked of something else.
    """
    if out is None:
        where = f"x{pose.x_mm}_depth{pose.focal_depth_mm}_angle{pose.angle_deg}"
        settings = [word.replace(" ", "") for word in in_words(pose)]
        out = Path("_".join([kind, *([label] if label else []), where, *settings]) + ".png")
    style.check_file(out, FORMATS)
    if plain and (kind != "frame" or out.suffix != ".png"):
        raise ConfigurationError("--plain is for a frame as .png: everything else has no pixels to be bare.")
    return out


def take(pose: Pose, kind: str = "frame", phantom: Tissue | None = None, label: str = "") -> Still:
    """Simulate what the default array sees of a phantom (None: the default) or anatomy, or take what is kept.

    Raises:
        ConfigurationError: If RF, envelope or settings of a recorded image are asked for.
    """
    phantom = Phantom() if phantom is None else phantom
    if not phantom.has_focus and (kind != "frame" or in_words(pose)):
        asked = kind if kind != "frame" else "settings of a scanner"
        raise ConfigurationError(f"a recorded image has no {asked}: leave it out, or simulate it.")
    plain, array, imaging = tuned(pose, DEFAULT_ARRAY, DEFAULT_IMAGING)
    if kind == "frame":
        frame = frame_store(phantom, DEFAULT_ARRAY, DEFAULT_IMAGING).frame(pose)
        rows = (0.0, imaging.depth * 1e3)
        if not phantom.has_focus:
            return Still(SLICE, pose, frame, rows, "255 for the image's largest voxel")
        unit = f"0 to 255 for the {imaging.dynamic_range_db:g} dB up to the frame's maximum"
        return Still(kind, pose, frame, rows, unit, label)
    positions, amplitudes = phantom.in_view(plain, *view(array, imaging))
    scene = (positions, amplitudes, array, pose.focal_depth_mm * 1e-3)
    attenuation = phantom.attenuation_db_per_cm_mhz
    if kind == "rf":
        rf, time = simulate_rf(*scene, attenuation_db_per_cm_mhz=attenuation)
        unit = f"arbitrary units, {array.rf_sampling_frequency / 1e6:g} MHz from time 0"
        return Still(kind, pose, rf, _edges(time * 1e6), unit, label)
    iq, time = simulate_iq(*scene, max_depth=imaging.depth, attenuation_db_per_cm_mhz=attenuation)
    depths_mm = array.speed_of_sound * (time - array.pulse_delay) / 2 * 1e3
    unit = (
        f"arbitrary units, {array.iq_sampling_frequency / 1e6:g} MHz from time 0 "
        f"(a depth of {depths_mm[0]:.2f} mm)"
    )
    return Still(kind, pose, envelope(iq), _edges(depths_mm), unit, label)


def write(still: Still, path: Path, plain: bool = False) -> None:
    """Write the numbers (.npy), the figure (.png) or, where `plain`, the bare pixels (.png)."""
    if path.suffix == ".npy":
        with atomic_file(path) as file:
            np.save(file, still.values)
    elif plain:
        with atomic_file(path) as file:
            Image.fromarray(still.values).save(file, format="PNG")
    else:
        style.save(figure(still), path)


def figure(still: Still) -> Figure:
    """Draw a frame or an envelope to scale, or RF over time, with axes and units."""
    left, right = _edges(DEFAULT_ARRAY.line_positions * 1e3)
    if still.kind in ("frame", SLICE):
        right = DEFAULT_IMAGING.width_px * DEFAULT_IMAGING.pixel_size * 1e3 / 2
        left = -right
    values, norm, label = _shades(still)
    to_scale = still.kind != "rf"
    # Tall enough that no period of RF falls between two pixels.
    drawn = Figure(figsize=(5.0, 7.0) if to_scale else (5.6, 14.0), dpi=150, layout="constrained")
    axes = drawn.add_subplot()
    shown = axes.imshow(
        values,
        cmap="gray",
        norm=norm,
        extent=(left, right, still.rows[1], still.rows[0]),
        aspect="equal" if to_scale else "auto",
    )
    drawn.colorbar(shown, ax=axes, label=label, shrink=0.6)
    axes.set_xlabel("lateral position (mm)")
    if to_scale:
        axes.set_ylabel("depth (mm)")
        if still.pose.focal_depth_mm <= still.rows[1] and still.kind != SLICE:
            axes.annotate(
                "◀ focus", (right, still.pose.focal_depth_mm), xytext=(2, 0), textcoords="offset points",
                color="#d55e00", fontsize=9, va="center", annotation_clip=False,
            )  # fmt: skip
    else:
        axes.set_ylabel("time (µs)")
    title = {"frame": "B-mode frame", SLICE: "Slice", "envelope": "Envelope", "rf": "RF"}[still.kind]
    focus = "" if still.kind == SLICE else f"focus {still.pose.focal_depth_mm} mm, "
    where = ", ".join(
        [f"x {still.pose.x_mm} mm", f"{focus}angle {still.pose.angle_deg}°", *in_words(still.pose)]
    )
    axes.set_title(f"{title}{still.label and f', {still.label}'}\n{where}", fontsize=10)
    return drawn


def _shades(still: Still) -> tuple[npt.NDArray[Any], Normalize, str]:
    """Return the values to show, how they become shades of grey, and what they are."""
    range_db = still.range_db
    if still.kind == "frame":
        decibels = still.values / 255 * range_db - range_db
        return decibels, Normalize(-range_db, 0.0), "dB relative to the frame's maximum"
    if still.kind == SLICE:
        return still.values, Normalize(0, 255), "grey level"
    # Silence, where the probe sees no scatterer, is divided by 1.
    relative = still.values / (float(np.abs(still.values).max(initial=0.0)) or 1.0)
    if still.kind == "rf":
        norm = SymLogNorm(RF_LINEAR, vmin=-1.0, vmax=1.0)
        return relative, norm, f"amplitude relative to the largest, linear within ±{RF_LINEAR:g}"
    decibels = 20 * np.log10(np.maximum(relative, 10 ** (-range_db / 20)))
    return decibels, Normalize(-range_db, 0.0), "dB relative to the envelope's maximum"


def _edges(centers: npt.NDArray[np.float64]) -> tuple[float, float]:
    """Return where the first of equally spaced samples begins and the last one ends."""
    half = (centers[1] - centers[0]) / 2
    return float(centers[0] - half), float(centers[-1] + half)
