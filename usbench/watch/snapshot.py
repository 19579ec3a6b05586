"""A snapshot from one pose: the B-mode frame, the envelope, the RF or the I/Q, as a picture or as numbers."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from usbench.checks import unknown
from usbench.envs.anatomy.points import PointScatterers
from usbench.envs.bmode import envelope
from usbench.envs.frames import frame_store
from usbench.envs.pose import Pose
from usbench.envs.rf import simulate_rf
from usbench.envs.scanner import acquire, scan, view
from usbench.envs.settings import in_words, tuned
from usbench.records import ConfigurationError
from usbench.watch.snapshot_option import Source, recorded

KINDS = ("frame", "envelope", "rf", "iq")
# A frame that was not simulated.
SLICE = "slice"


@dataclass(frozen=True)
class Snapshot:
    """What the probe sees from a pose.

    Attributes:
        kind: One of KINDS, or SLICE.
        source: What is examined, and with what.
        pose: Pose of the probe.
        values: (height_px, width_px) uint8 of a frame, else (n_samples, n_lines) float32, of I/Q complex64.
        rows: Where the first row begins and the last one ends, depth in mm.
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
    def x(self) -> npt.NDArray[np.float64]:
        """Lateral positions of the columns from the probe's centre, (n_columns,) m."""
        n = self.values.shape[1]
        return np.asarray(2e-3 * self.half_width * ((np.arange(n) + 0.5) / n - 0.5))

    @property
    def z(self) -> npt.NDArray[np.float64]:
        """Depths of the rows, (n_rows,) m: of a sample the place whose echo has the pulse's middle then."""
        n, (first, last) = len(self.values), self.rows
        return 1e-3 * (first + (last - first) * (np.arange(n) + 0.5) / n)

    @property
    def sampling_frequency(self) -> float:
        """Samples of a line per second, Hz; of a frame those that its pixels stand for."""
        first, last = self.rows
        return self.source.probe.speed_of_sound * len(self.values) / (2e-3 * (last - first))

    @property
    def half_width(self) -> float:
        """Distance (mm) from the middle to the outer edge of the first and the last column."""
        is_frame = self.kind in ("frame", SLICE)
        return 1e3 * (self.source.imaging.width if is_frame else self.source.probe.width) / 2


def take(source: Source, pose: Pose, kind: str = "frame") -> Snapshot:
    """Simulate what is seen of a source from a pose, or take the frame that is kept; RF is without noise.

    Raises:
        ConfigurationError: If `kind` is none of KINDS, RF, envelope or settings of a recorded image are asked
            for, or all scatterers of a file are out of view.
    """
    if kind not in KINDS:
        raise ConfigurationError(str(unknown("kind", kind, KINDS)))
    tissue = source.tissue
    if not tissue.has_focus and (kind != "frame" or in_words(pose)):
        raise recorded(kind if kind != "frame" else "settings of a scanner")
    plain, probe, imaging = tuned(pose, source.probe, source.imaging)
    if isinstance(tissue, PointScatterers):
        _check_seen(tissue, plain, *view(probe, imaging))
    if kind == "frame":
        if isinstance(tissue, PointScatterers):
            frame = scan(tissue, pose, source.probe, source.imaging)
        else:
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
        values: npt.NDArray[Any]
        values, time = simulate_rf(*scene, attenuation_db_per_cm_mhz=attenuation)
        # Later echoes come from beside the lines, and none of them is in the frame.
        last = np.searchsorted(time, 2 * imaging.depth / probe.speed_of_sound + 2 * probe.pulse_delay)
        values, time = values[:last], time[:last]
    else:
        values = acquire(tissue, pose, source.probe, source.imaging)
        time = np.arange(len(values)) / probe.iq_sampling_frequency
        values = envelope(values) if kind == "envelope" else values
    depths_mm = probe.speed_of_sound * (time - probe.pulse_delay) / 2 * 1e3
    unit = (
        f"arbitrary units, {1e-6 / (time[1] - time[0]):g} MHz from time 0 (a depth of {depths_mm[0]:.2f} mm)"
    )
    return Snapshot(kind, source, pose, values, _edges(depths_mm), unit)


def _check_seen(points: PointScatterers, pose: Pose, half_width_m: float, half_thickness_m: float) -> None:
    if not len(points.in_view(pose, half_width_m, half_thickness_m)[1]):
        raise ConfigurationError(
            f"none of the {len(points.amplitudes)} scatterers is in view, within {half_width_m * 1e3:g} mm "
            f"of the probe's centre and {half_thickness_m * 1e3:g} mm of its image plane."
        )


def _edges(centers: npt.NDArray[np.float64]) -> tuple[float, float]:
    """Return where the first of equally spaced samples begins and the last one ends."""
    half = (centers[1] - centers[0]) / 2
    return float(centers[0] - half), float(centers[-1] + half)
