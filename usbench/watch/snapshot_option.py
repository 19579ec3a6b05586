"""What a snapshot is taken of: tissue, probe and imaging, the pose of the probe, the scanner's settings."""

import hashlib
import math
from dataclasses import dataclass, fields, replace
from typing import Any

from gymnasium.envs.registration import load_env_creator

from usbench.checks import as_configuration_error, number, whole_number
from usbench.envs.anatomy.points import PointScatterers
from usbench.envs.bmode import DEFAULT_IMAGING, MOST_DB, MOST_SIZE, Imaging
from usbench.envs.frames import check_recorded
from usbench.envs.phantom import Phantom
from usbench.envs.pose import Pose
from usbench.envs.probe import DEFAULT_ARRAY, LinearArray
from usbench.envs.settings import Setup, tuned
from usbench.envs.tasks.phantom_distribution import PhantomDistribution, phantom_number
from usbench.envs.tasks.random_phantoms import RandomPhantomEnv
from usbench.envs.tissue import Tissue
from usbench.records import ConfigurationError
from usbench.setting_parts import toml_files
from usbench.tasks import PAPER, row_of, rows

# As far as the simulator focuses; a focus below the phantom is allowed, as on a scanner.
DEEPEST_MM = 500
# As scanners have with such an array; its pulses are sampled finely enough for it.
FREQUENCY_MHZ = (1.0, 10.0)
RANGE_DB = (1, MOST_DB)
PIXEL_MM = (0.01, 10.0)
# Of a file of scatterers: half a wavelength at 3.8 MHz, and no filter that removes a point.
POINT_PIXEL_MM = 0.2


@dataclass(frozen=True)
class Source:
    """What a snapshot is taken of, and with what.

    Attributes:
        tissue: What is examined.
        label: Name of the tissue, "" for the phantom of the paper's tasks.
        probe: The transducer.
        imaging: How RF becomes a frame.
        usual: The imaging of the task, from which `changes` are told.
    """

    tissue: Tissue | PointScatterers = Phantom()
    label: str = ""
    probe: LinearArray = DEFAULT_ARRAY
    imaging: Imaging = DEFAULT_IMAGING
    usual: Imaging = DEFAULT_IMAGING

    @property
    def changes(self) -> list[str]:
        """What differs from the task's own: a probe of usbench by its name, else fields as "n_lines 96"."""
        name = toml_files.preset_of(self.probe)
        probe = [f"probe {name}"] if name else _changed(self.probe, DEFAULT_ARRAY)
        return probe + _changed(self.imaging, self.usual)

    @property
    def names(self) -> list[str]:
        """Parts of the name of a file: the label, and a digest of what differs from the defaults."""
        digest = hashlib.sha256(repr((self.probe, self.imaging)).encode()).hexdigest()[:8]
        return [name for name in (self.label, digest if self.changes else "") if name]


def _changed(part: LinearArray | Imaging, own: LinearArray | Imaging) -> list[str]:
    """Return the fields of `part` that differ from those of `own`, with their values."""
    return [
        f"{field.name} {value:g}" if isinstance(value, int | float) else f"{field.name} {value}"
        for field in fields(part)
        if (value := getattr(part, field.name)) != getattr(own, field.name)
    ]


def placed(
    source: Source,
    x_mm: Any,
    focal_depth_mm: Any,
    angle_deg: Any,
    frequency_mhz: Any = None,
    dynamic_range_db: Any = None,
) -> tuple[Source, Pose]:
    """Return source and pose, on the tasks' grid or off it, with the scanner's settings that are given.

    A frequency makes settings of both, which the pose has. A dynamic range alone is that of the source's
    imaging, and the probe keeps its frequency, whatever it is.

    Raises:
        ConfigurationError: If a value is not allowed, the probe is not on the tissue, does not sample such a
            frequency, or settings of a recorded image are asked for.
    """
    with as_configuration_error():
        if not source.tissue.has_focus:
            check_recorded(source.probe, source.imaging, source.usual)
        pose = _on(source.tissue, Pose(x_mm, focal_depth_mm, angle_deg))
        if frequency_mhz is None and dynamic_range_db is None:
            return source, pose
        if not source.tissue.has_focus:
            raise recorded("settings of a scanner")
        range_db = _range_db(source.imaging, dynamic_range_db)
        if frequency_mhz is None:
            return replace(source, imaging=replace(source.imaging, dynamic_range_db=range_db)), pose
        low, high = FREQUENCY_MHZ
        khz = _whole_khz(number("frequency_mhz", frequency_mhz, low=low, high=high))
        place = (pose.x_mm, pose.focal_depth_mm, pose.angle_deg)
        setup = Setup(*place, frequency_khz=khz, dynamic_range_db=range_db)
        tuned(setup, source.probe, source.imaging)  # refuses a frequency that this probe does not sample
        return source, setup


def recorded(asked: str) -> ConfigurationError:
    """Return the error for what a recorded image does not have."""
    return ConfigurationError(f"a recorded image has no {asked}: leave it out, or simulate it.")


def _on(tissue: Tissue | PointScatterers, pose: Pose) -> Pose:
    """Return the pose, or raise ValueError if the probe is not on the tissue, or focused too deep."""
    edge = int(tissue.width_mm // 2)
    if abs(pose.x_mm) > edge:
        raise ValueError(f"x_mm must be in [-{edge}, {edge}], where the phantom is, not {pose.x_mm}.")
    if pose.focal_depth_mm > DEEPEST_MM:
        raise ValueError(f"focal_depth_mm must be in [1, {DEEPEST_MM}], not {pose.focal_depth_mm}.")
    return pose


def imaging_of(source: Source, pixel_mm: Any = None, median_size: Any = None) -> Imaging:
    """Return the imaging of a source with pixels of another size, and another median filter.

    The frame keeps its extent. A frame of a file of scatterers, where the source has the default imaging, is
    as wide as the scan lines, reaches below the deepest scatterer, and has fine pixels, not filtered.

    Raises:
        ConfigurationError: If a value is not allowed.
    """
    imaging, points = source.imaging, source.tissue
    width, depth = imaging.width, imaging.depth
    if isinstance(points, PointScatterers) and imaging == DEFAULT_IMAGING:
        pixel_mm = POINT_PIXEL_MM if pixel_mm is None else pixel_mm
        median_size = 1 if median_size is None else median_size
        # Room for the pulse, and whole mm for the axis.
        deepest = float(points.positions[:, 2].max())
        width, depth = source.probe.width, min(math.ceil(1.05e3 * deepest + 2) * 1e-3, MOST_SIZE)
    with as_configuration_error():
        if median_size is not None:
            imaging = replace(imaging, median_size=median_size)
        if pixel_mm is not None:
            size = number("pixel_mm", pixel_mm, low=PIXEL_MM[0], high=PIXEL_MM[1]) * 1e-3
            most = math.floor(MOST_SIZE / size * (1 + 1e-9))
            height_px, width_px = (min(max(round(side / size), 1), most) for side in (depth, width))
            imaging = replace(imaging, pixel_size=size, height_px=height_px, width_px=width_px)
    return imaging


def _whole_khz(frequency_mhz: float) -> int:
    khz = round(frequency_mhz * 1e3)
    if abs(frequency_mhz * 1e3 - khz) > 1e-6:
        raise ValueError(f"frequency_mhz must be in whole kHz, as 3.5 is, not {frequency_mhz!r}.")
    return khz


def _range_db(imaging: Imaging, dynamic_range_db: Any) -> int:
    if dynamic_range_db is None:  # then there is a frequency
        name = "the imaging's dynamic_range_db beside a frequency"
        return whole_number(name, imaging.dynamic_range_db, *RANGE_DB)
    return whole_number("dynamic_range_db", dynamic_range_db, *RANGE_DB)


def label(task: str | None, number: Any = None) -> str:
    """Return what a phantom is called, "" where it is that of the paper's tasks."""
    if task is None or task in PAPER:
        return ""
    return f"{task}-{number or 0}" if row_of(task).phantoms else task


def usual_imaging(task: str | None) -> Imaging:
    """Return how a task makes frames by default.

    Raises:
        ConfigurationError: If there is no such task.
    """
    with as_configuration_error():
        environment: Any = load_env_creator(row_of(task or PAPER[0]).entry_point)
        return environment.default_imaging  # type: ignore[no-any-return]


def phantom_of(task: str | None, number: Any = None) -> Phantom:
    """Return the phantom of a task, where it has many that of this number (default 0).

    Raises:
        ConfigurationError: If there is no such task or number, or the task has one phantom alone.
    """
    with as_configuration_error():
        environment: Any = load_env_creator(row_of(task or PAPER[0]).entry_point)
        if issubclass(environment, RandomPhantomEnv):
            phantoms: PhantomDistribution = environment.distribution
            return phantoms.phantom(phantom_number(0 if number is None else number))
        if number is not None:
            many = ", ".join(name for name, row in rows().items() if row.phantoms)
            raise ValueError(
                f"only {many} have several phantoms to choose from by number: every other task has one."
            )
        return environment.default_phantom  # type: ignore[no-any-return]
