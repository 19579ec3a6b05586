"""RF of a frame by esdiva (the Field II method), to be timed and compared with the RF of usbench.

Needs the extra `bench`: pip install -e '.[bench]'.
"""

from __future__ import annotations

import contextlib
import io
import time
import warnings

import numpy as np
import numpy.typing as npt
from esdiva import Reception
from esdiva.transducers import LinearArrayTransducer

from usbench.envs.probe import LinearArray

Floats = npt.NDArray[np.float64]


class Peer:
    """The array of `LinearArray` in esdiva, with 1 x `n_elevation` rectangles per element."""

    def __init__(self, array: LinearArray) -> None:
        """Give the active aperture its apodisation and pulse."""
        self._array = array
        with contextlib.redirect_stdout(io.StringIO()), warnings.catch_warnings():
            warnings.simplefilter(
                "ignore", UserWarning
            )  # it warns of apodised reception, which is meant here
            aperture = LinearArrayTransducer(
                n_elements=array.n_active,
                element_width_mm=array.element_width * 1e3,
                element_height_mm=array.element_height * 1e3,
                kerf_mm=array.kerf * 1e3,
                no_sub_x=1,
                no_sub_y=array.n_elevation,
                frequency_Hz=array.center_frequency,
            )
            aperture.apodization = array.apodization
            self._reception = Reception(
                aperture,
                aperture.copy(),
                c=array.speed_of_sound,
                fs=array.sampling_frequency,
                excitation=array.pulse
                * array.sampling_frequency**2,  # the pulse of transmission and reception
                method="fst",
                verbose=False,
            )

    def line(
        self, positions: Floats, amplitudes: Floats, focal_depth: float, line: float
    ) -> tuple[npt.NDArray[np.float32], float]:
        """Return RF of the line at `line` m, at `sampling_frequency`, and the time of its first sample."""
        array, reception = self._array, self._reception
        center = float(array.aperture_centers(np.array([line]))[0])
        elements = (np.arange(array.n_active) - (array.n_active - 1) / 2) * array.pitch
        path = np.hypot(elements - (line - center), focal_depth)
        delays = (path.max() - path) / array.speed_of_sound
        reception.tx.delays = reception.rx.delays = delays
        # As scan_focusline of esdiva does, which allows neither these delays nor this apodisation.
        reception._refresh_sub_elem_attributes()
        rf, coords = reception._focused_sum_rf(positions - [center, 0.0, 0.0], amplitudes)
        # Time 0 of esdiva is the pulse's centre at the first firing; here it is when (line, 0, 0) fires.
        first = coords["t0"] + coords["pulse_center_lag_s"] + 2 * float(delays.max())
        return rf, first - 2 * float(path.max() - focal_depth) / array.speed_of_sound

    def frame(
        self, positions: Floats, amplitudes: Floats, focal_depth: float, lines: Floats
    ) -> tuple[list[tuple[npt.NDArray[np.float32], float]], float]:
        """Return all lines, as `line` does, and the seconds that they took, without the time of compiling."""
        self.line(positions[:2], amplitudes[:2], focal_depth, float(lines[0]))
        start = time.perf_counter()
        signals = [self.line(positions, amplitudes, focal_depth, float(line)) for line in lines]
        return signals, time.perf_counter() - start
