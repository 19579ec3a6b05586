"""The heart: a frame, from the pose of the probe to the pixels."""

from __future__ import annotations

import reprlib
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from usbench.checks import check_type
from usbench.envs.bmode import DEFAULT_IMAGING, Imaging, simulated_bmode
from usbench.envs.pose import Pose
from usbench.envs.probe import DEFAULT_ARRAY, LinearArray, check_array
from usbench.envs.receiver.noise import noise
from usbench.envs.rf import simulate_iq
from usbench.envs.settings import table_of, tuned
from usbench.envs.threads import in_parallel
from usbench.envs.tissue import Scatterers, Tissue


def view(array: LinearArray, imaging: Imaging) -> tuple[float, float]:
    """Return half width and half thickness (m) of what a frame is made of, as `in_view` takes them.

    It is as wide as the image or the scan lines, whichever is wider: tissue beside the image spreads into it.
    """
    return max(array.width, imaging.width) / 2, array.slice_thickness / 2


def scan(
    phantom: Scatterers, pose: Pose, array: LinearArray = DEFAULT_ARRAY, imaging: Imaging = DEFAULT_IMAGING
) -> npt.NDArray[np.uint8]:
    """Return the B-mode frame of `phantom` from `pose`, (height_px, width_px) uint8: depth, lateral.

    A pure function of its arguments, all of them frozen values. A `Setup` has its settings in place of the
    array's and the imaging's.

    Raises:
        TypeError: If an argument has the wrong type.
        ValueError: If the scatterers, the focus and the array do not go together, as in `simulate_iq`.
    """
    iq = acquire(phantom, pose, array, imaging)
    _, array, imaging = tuned(pose, array, imaging)
    return simulated_bmode(iq, array, imaging)


def acquire(
    phantom: Scatterers, pose: Pose, array: LinearArray = DEFAULT_ARRAY, imaging: Imaging = DEFAULT_IMAGING
) -> npt.NDArray[np.complex64]:
    """Return the I/Q from which `scan` makes the frame, (n_samples, n_lines), with noise if imaging has any.

    Time and rate are those of `simulate_iq`.

    Raises:
        TypeError: If an argument has the wrong type.
    """
    _check(phantom, pose, array, imaging)
    pose, array, imaging = tuned(pose, array, imaging)
    positions, amplitudes = phantom.in_view(pose, *view(array, imaging))
    iq, _ = simulate_iq(
        positions,
        amplitudes,
        array,
        pose.focal_depth_mm * 1e-3,
        max_depth=imaging.depth,
        attenuation_db_per_cm_mhz=phantom.attenuation_db_per_cm_mhz,
    )
    if imaging.noise_db is None:
        return iq
    tissue = phantom.shown if isinstance(phantom, Tissue) else phantom
    return iq + noise((iq.shape[0], iq.shape[1]), imaging.noise_db, array, tissue, pose)


def _check(phantom: object, pose: object, array: object, imaging: object) -> None:
    check_array(array)
    check_type("pose", pose, Pose)
    check_type("imaging", imaging, Imaging)
    if not callable(getattr(phantom, "in_view", None)):
        raise TypeError(
            f"phantom must be of type Phantom, Anatomy or PointScatterers, not {reprlib.repr(phantom)}."
        )


def scan_batch(
    scenes: Sequence[tuple[Scatterers, Pose]],
    array: LinearArray = DEFAULT_ARRAY,
    imaging: Imaging = DEFAULT_IMAGING,
) -> npt.NDArray[np.uint8]:
    """Return the frames of many phantoms and poses at once, (n, height_px, width_px) uint8.

    The same bits as `scan` one by one, faster: every core makes other frames.

    Raises:
        TypeError: If `imaging` is no `Imaging`.
    """
    check_type("imaging", imaging, Imaging)
    scenes = list(scenes)
    frames = np.empty((len(scenes), imaging.height_px, imaging.width_px), dtype=np.uint8)

    def make(k: int) -> None:
        frames[k] = scan(*scenes[k], array, imaging)

    tables = [table_of(pose) for _, pose in scenes]
    for table in sorted(set(tables)):
        first, *others = (k for k in range(len(scenes)) if tables[k] == table)
        make(first)  # all cores make the table
        in_parallel(make, others)
    return frames
