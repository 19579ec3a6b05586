"""Element signals of a frame by zea, to be timed beside usbench; needs `pip install zea` with PyTorch.

zea has no scan lines: it returns what every element hears of every transmit, and its own beamformers, not
timed here, make lines of that. Its time is proportional to the scatterers, of which some are taken.
"""

from __future__ import annotations

import os
import time

import numpy as np
import numpy.typing as npt

from usbench.envs.probe import LinearArray

Floats = npt.NDArray[np.float64]
DEEPEST = 90e-3


def seconds(positions: Floats, amplitudes: Floats, array: LinearArray, focal_depth: float) -> float:
    """Return the seconds that all focused transmits of a frame take, heard by all elements."""
    os.environ.setdefault("KERAS_BACKEND", "torch")
    from keras import ops
    from zea.simulator import simulate_rf

    lines, pitch = array.line_positions, array.pitch
    elements = (np.arange(array.n_elements) - (array.n_elements - 1) / 2) * pitch
    from_center = elements - array.aperture_centers(lines)[:, np.newaxis]
    active = np.abs(from_center) < array.aperture_width / 2
    path = np.hypot(elements - lines[:, np.newaxis], focal_depth)
    delays = np.where(active, path.max() - path, 0.0) / array.speed_of_sound
    rate = 4 * array.center_frequency  # the pulse's band, twice

    def tensor(values: npt.ArrayLike) -> object:
        return ops.convert_to_tensor(np.asarray(values, dtype=np.float32))

    def simulated(n: int) -> None:
        ops.convert_to_numpy(
            simulate_rf(
                scatterer_positions=tensor(positions[:n]),
                scatterer_magnitudes=tensor(amplitudes[:n]),
                probe_geometry=tensor(np.stack([elements, 0 * elements, 0 * elements], axis=1)),
                apply_lens_correction=False,
                lens_thickness=1e-3,
                lens_sound_speed=1000.0,
                sound_speed=array.speed_of_sound,
                n_ax=round(2 * DEEPEST / array.speed_of_sound * rate),
                center_frequency=array.center_frequency,
                sampling_frequency=rate,
                t0_delays=tensor(delays),
                initial_times=tensor(np.zeros(len(lines))),
                element_width=array.element_width,
                element_height=array.element_height,
                attenuation_coef=0.0,
                tx_apodizations=tensor(np.where(active, array.window(from_center), 0.0)),
                t_peak=tensor(np.full(len(lines), 1 / array.center_frequency)),
            )
        )

    simulated(1)
    start = time.perf_counter()
    simulated(len(positions))
    return time.perf_counter() - start
