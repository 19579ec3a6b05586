"""One picture from one pose: the B-mode frame, the envelope or the RF, as an image or as numbers."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.colors import Normalize, SymLogNorm
from matplotlib.figure import Figure
from PIL import Image

from usbench import drawing
from usbench.atomic import atomic_file
from usbench.envs.anatomy import Anatomy, Echogenicity, Recording
from usbench.envs.bmode import DEFAULT_IMAGING, envelope
from usbench.envs.frames import frame_store
from usbench.envs.phantom import Phantom
from usbench.envs.pose import Pose
from usbench.envs.probe import DEFAULT_ARRAY
from usbench.envs.rf import simulate_iq, simulate_rf
from usbench.envs.scanner import HALF_THICKNESS, HALF_WIDTH
from usbench.records import ConfigurationError

KINDS = ("frame", "envelope", "rf")
# A frame that was not simulated.
SLICE = "slice"
FORMATS = (".png", ".npy")
# As far as the simulator focuses; a focus below the phantom is allowed, as on a scanner.
DEEPEST_MM = 500
RANGE_DB = DEFAULT_IMAGING.dynamic_range_db
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
    """

    kind: str
    pose: Pose
    values: npt.NDArray[Any]
    rows: tuple[float, float]
    unit: str


def pose(x_mm: Any, focal_depth_mm: Any, angle_deg: Any) -> Pose:
    """Return the pose, on the tasks' grid or off it.

    Raises:
        ConfigurationError: If a value is not a whole number, or the probe is not on the phantom.
    """
    try:
        found = Pose(x_mm, focal_depth_mm, angle_deg)
        edge = int(Phantom().width_mm // 2)
        if abs(found.x_mm) > edge:
            raise ValueError(f"x_mm must be in [-{edge}, {edge}], where the phantom is, not {found.x_mm}.")
        if found.focal_depth_mm > DEEPEST_MM:
            raise ValueError(f"focal_depth_mm must be in [1, {DEEPEST_MM}], not {found.focal_depth_mm}.")
    except (TypeError, ValueError) as error:
        raise ConfigurationError(str(error)) from error
    return found


def path(out: Path | None, kind: str, pose: Pose, plain: bool = False) -> Path:
    """Return the file to write, named after the pose unless `out` says its name.

    Raises:
        ConfigurationError: If its ending is not one of FORMATS, its folder does not exist, or `plain`, which
            is for the pixels of a frame, is asked of something else.
    """
    if out is None:
        out = Path(f"{kind}_x{pose.x_mm}_depth{pose.focal_depth_mm}_angle{pose.angle_deg}.png")
    drawing.check_file(out, FORMATS)
    if plain and (kind != "frame" or out.suffix != ".png"):
        raise ConfigurationError("--plain is for a frame as .png: everything else has no pixels to be bare.")
    return out


def take(pose: Pose, kind: str = "frame", anatomy: Anatomy | None = None) -> Still:
    """Simulate what the default array sees of the default phantom, or of an anatomy, or take what is kept.

    Raises:
        ConfigurationError: If RF or envelope of a recorded image is asked for.
    """
    phantom, array = anatomy or Phantom(), DEFAULT_ARRAY
    if kind == "frame":
        frame = frame_store(phantom, array, DEFAULT_IMAGING).frame(pose)
        rows = (0.0, DEFAULT_IMAGING.depth * 1e3)
        if isinstance(phantom, Recording):
            return Still(SLICE, pose, frame, rows, "255 for the image's largest voxel")
        return Still(kind, pose, frame, rows, f"0 to 255 for the {RANGE_DB:g} dB up to the frame's maximum")
    if isinstance(phantom, Recording):
        raise ConfigurationError(f"a recorded image has no {kind}: leave it out, or simulate it.")
    assert isinstance(phantom, Phantom | Echogenicity)
    positions, amplitudes = phantom.in_view(pose, HALF_WIDTH, HALF_THICKNESS)
    scene = (positions, amplitudes, array, pose.focal_depth_mm * 1e-3)
    if kind == "rf":
        rf, time = simulate_rf(*scene)
        unit = f"arbitrary units, {array.rf_sampling_frequency / 1e6:g} MHz from time 0"
        return Still(kind, pose, rf, _edges(time * 1e6), unit)
    iq, time = simulate_iq(*scene, max_depth=DEFAULT_IMAGING.depth)
    depths_mm = array.speed_of_sound * (time - array.pulse_delay) / 2 * 1e3
    unit = (
        f"arbitrary units, {array.iq_sampling_frequency / 1e6:g} MHz from time 0 "
        f"(a depth of {depths_mm[0]:.2f} mm)"
    )
    return Still(kind, pose, envelope(iq), _edges(depths_mm), unit)


def write(still: Still, path: Path, plain: bool = False) -> None:
    """Write the numbers (.npy), the figure (.png) or, where `plain`, the bare pixels (.png)."""
    if path.suffix == ".npy":
        with atomic_file(path) as file:
            np.save(file, still.values)
    elif plain:
        with atomic_file(path) as file:
            Image.fromarray(still.values).save(file, format="PNG")
    else:
        drawing.save(figure(still), path)


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
    where = f"x {still.pose.x_mm} mm, {focus}angle {still.pose.angle_deg}°"
    axes.set_title(f"{title}\n{where}", fontsize=10)
    return drawn


def _shades(still: Still) -> tuple[npt.NDArray[Any], Normalize, str]:
    """Return the values to show, how they become shades of grey, and what they are."""
    if still.kind == "frame":
        decibels = still.values / 255 * RANGE_DB - RANGE_DB
        return decibels, Normalize(-RANGE_DB, 0.0), "dB relative to the frame's maximum"
    if still.kind == SLICE:
        return still.values, Normalize(0, 255), "grey level"
    # Silence, where the probe sees no scatterer, is divided by 1.
    relative = still.values / (float(np.abs(still.values).max(initial=0.0)) or 1.0)
    if still.kind == "rf":
        norm = SymLogNorm(RF_LINEAR, vmin=-1.0, vmax=1.0)
        return relative, norm, f"amplitude relative to the largest, linear within ±{RF_LINEAR:g}"
    decibels = 20 * np.log10(np.maximum(relative, 10 ** (-RANGE_DB / 20)))
    return decibels, Normalize(-RANGE_DB, 0.0), "dB relative to the envelope's maximum"


def _edges(centers: npt.NDArray[np.float64]) -> tuple[float, float]:
    """Return where the first of equally spaced samples begins and the last one ends."""
    half = (centers[1] - centers[0]) / 2
    return float(centers[0] - half), float(centers[-1] + half)
