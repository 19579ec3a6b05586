"""Ultrasound file format (UFF): beamformed lines or an image with their geometry, as USTB reads them.

Rodriguez-Molares, Rindal, Bernard et al., "The UltraSound ToolBox", Proc. IEEE Ultrason. Symp. (2017). The
file holds one `uff.beamformed_data` called `b_data`: its pixels on a `uff.linear_scan`, the probe, and one
focused wave per line. The package pyuff_ustb writes it.
"""

from __future__ import annotations

import io
import math
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from usbench.atomic import atomic_file
from usbench.checks import install
from usbench.envs.settings import tuned
from usbench.records import ConfigurationError

if TYPE_CHECKING:
    from usbench.watch.snapshot import Snapshot

# Where USTB's examples keep beamformed data.
LOCATION = "b_data"


def check_installed() -> None:
    """Raise ConfigurationError if the package that writes these files is missing."""
    if find_spec("pyuff_ustb") is None:
        raise ConfigurationError(f"a .uff file is written by pyuff_ustb: {install('uff')}.")


def write(taken: Snapshot, path: Path) -> None:
    """Write a snapshot.

    RF and envelope are real, I/Q is complex with its carrier as `modulation_frequency`. Of a frame the pixels
    are amplitudes, 1 at the frame's maximum: 20 log10 of them, which USTB shows, are its decibels.
    """
    import h5py
    from pyuff_ustb import BeamformedData, LinearArray, LinearScan, Point, Wave, Wavefront
    from pyuff_ustb.objects.uff import write_object

    pose, probe, _ = tuned(taken.pose, taken.source.probe, taken.source.imaging)
    focal_depth = pose.focal_depth_mm * 1e-3
    waves = [
        Wave(
            wavefront=Wavefront.spherical,
            source=Point(
                distance=math.hypot(x, focal_depth), azimuth=math.atan2(x, focal_depth), elevation=0.0
            ),
            origin=Point(distance=abs(x), azimuth=math.copysign(math.pi / 2, x), elevation=0.0),
            sound_speed=probe.speed_of_sound,
        )
        for x in probe.line_positions.tolist()
    ]
    data = BeamformedData(
        scan=LinearScan(x_axis=taken.x, z_axis=taken.z),
        data=_amplitudes(taken).T.reshape(-1),  # pixels column by column, as USTB counts them
        probe=LinearArray(
            N=probe.n_elements,
            pitch=probe.pitch,
            element_width=probe.element_width,
            element_height=probe.element_height,
        ),
        sequence=waves,
        sampling_frequency=taken.sampling_frequency,
        modulation_frequency=probe.iq_center_frequency if taken.kind == "iq" else 0.0,
    )
    content = io.BytesIO()
    with h5py.File(content, "w") as hdf5:
        # Waves have no apodisation here: it would be one of USTB's windows over the whole array.
        write_object(hdf5, data, LOCATION, ignore_missing_compulsory_fields=True)
    with atomic_file(path) as file:
        file.write(content.getbuffer())


def _amplitudes(taken: Snapshot) -> npt.NDArray[Any]:
    if taken.values.dtype != np.uint8:
        return taken.values
    return 10.0 ** (taken.range_db * (taken.values / 255 - 1) / 20)
