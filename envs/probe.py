"""The transducer and its acquisition: one frozen dataclass in SI units."""

from __future__ import annotations

import math
import reprlib
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
import numpy.typing as npt

from usbench.checks import (
    HERTZ,
    METRES,
    METRES_PER_SECOND,
    number,
    plain,
    positive,
    quantity,
    whole_number,
)

_WHOLE = ("n_elements", "n_active", "n_lines", "n_elevation")
_CYCLES = ("excitation_cycles", "impulse_response_cycles")
# Wider than any array of medicine or material testing, and too narrow for a value in another unit.
_BOUNDS = {
    "center_frequency": (1e5, 1e8, HERTZ),
    "sampling_frequency": (1e6, 1e10, HERTZ),
    "speed_of_sound": (300.0, 1e4, METRES_PER_SECOND),
    "element_width": (1e-6, 10e-3, METRES),
    "kerf": (0.0, 10e-3, METRES),
    "element_height": (1e-6, 0.1, METRES),
    "line_spacing": (1e-6, 20e-3, METRES),
    "slice_thickness": (1e-6, 0.2, METRES),
    "receive_focus": (1e-4, 0.5, METRES),
}
DYNAMIC = "dynamic"  # of `receive_focus`
# Also of a single element that is far smaller than a wavelength, and of a sparse array.
_PITCH_WAVELENGTHS = 0.01, 10.0
_MOST_KERF = 4.0
_WIDEST = 0.5
_MOST_RECTANGLES = 1000


@dataclass(frozen=True)
class LinearArray:
    """A linear array whose active aperture walks along with the scan line.

    Transmit and receive share aperture, apodisation and delays: a Hann window over the `n_active` elements
    nearest to the line, and one fixed focus on the line, unless `receive_focus` or `receive_f_number` set the
    receive apart. Defaults: Jarosik and Lewandowski (2019).

    Attributes:
        center_frequency: Of the excitation and of the impulse response, Hz.
        sampling_frequency: At which excitation and impulse response are sampled, Hz.
        speed_of_sound: m/s.
        n_elements: Number of elements.
        element_width: Extent of an element along the array, m.
        kerf: Gap between neighbouring elements, m.
        element_height: Extent of an element in elevation, m; there is no elevation focus.
        n_active: Number of active elements of a line.
        n_lines: Number of scan lines.
        line_spacing: Distance between neighbouring lines, m; the lines are centred on the array.
        excitation_cycles: Cycles of the excitation, a sine burst.
        impulse_response_cycles: Cycles of an element's impulse response, a sine burst times a Hann window.
        n_elevation: Number of rectangles into which an element is divided in elevation.
        slice_thickness: Thickness in elevation of the tissue that makes a frame, m; scatterers farther than
            half of it from the image plane are left out. The paper's authors simulate 10 mm, twice the
            height of their elements.
        receive_focus: Depth that is focused on in receive, m; "dynamic": on the depth c t / 2 at the time t,
            that is on every scatterer at its distance. None: on the focal depth, as in transmit.
        receive_f_number: The receive aperture is at most as wide as the depth of the receive focus divided by
            this number: a Hann window about the line. None: the aperture of the transmit.

    Raises:
        TypeError: If an attribute has a wrong type.
        ValueError: If a value is not allowed, by itself or beside the others; the message says what is.
    """

    center_frequency: float = 3.5e6
    sampling_frequency: float = 100e6
    speed_of_sound: float = 1540.0
    n_elements: int = 192
    element_width: float = 0.44e-3
    kerf: float = 0.05e-3
    element_height: float = 5e-3
    n_active: int = 64
    n_lines: int = 64
    line_spacing: float = 0.625e-3
    excitation_cycles: float = 2.0
    impulse_response_cycles: float = 2.0
    n_elevation: int = 10
    slice_thickness: float = 10e-3
    receive_focus: float | str | None = None
    receive_f_number: float | None = None

    def __post_init__(self) -> None:
        """Hold the values as plain numbers, or refuse them."""
        for name in (field.name for field in fields(self)):
            object.__setattr__(self, name, _checked(name, getattr(self, name)))
        if self.n_active > self.n_elements:
            raise ValueError(f"n_active must be at most n_elements = {self.n_elements}, not {self.n_active}.")
        if self.sampling_frequency < 7 * self.center_frequency:
            raise ValueError(
                "sampling_frequency must be at least 7 times center_frequency "
                f"({7 * self.center_frequency:g} Hz), not {self.sampling_frequency:g}."
            )
        self._check_proportions()

    def _check_proportions(self) -> None:
        """Refuse values of which each is possible, but not all of them together."""
        if self.n_elements > 1 and self.kerf > _MOST_KERF * self.element_width:
            raise ValueError(
                f"kerf, the gap between elements, must be at most {_MOST_KERF:g} times element_width "
                f"({plain(_MOST_KERF * self.element_width)} m), not {plain(self.kerf)}."
            )
        low, high = (plain(limit * self.wavelength) for limit in _PITCH_WAVELENGTHS)
        if not _PITCH_WAVELENGTHS[0] <= self.pitch / self.wavelength <= _PITCH_WAVELENGTHS[1]:
            raise ValueError(
                "element_width + kerf must be between a hundredth of a wavelength and ten "
                f"([{low}, {high}] m at {plain(self.center_frequency)} Hz), not {plain(self.pitch)}."
            )
        for count, step, width in (
            ("n_elements", "the pitch", self.n_elements * self.pitch),
            ("n_lines", "line_spacing", self.width),
        ):
            if width > _WIDEST:
                raise ValueError(f"{count} times {step} must be at most {_WIDEST} m, not {plain(width)} m.")
        if self.n_elevation > _MOST_RECTANGLES:
            raise ValueError(f"n_elevation must be at most {_MOST_RECTANGLES}, not {self.n_elevation}.")

    @property
    def pitch(self) -> float:
        """Distance between the centres of neighbouring elements, m."""
        return self.element_width + self.kerf

    @property
    def aperture_width(self) -> float:
        """Width of the elements that fire for one line, m."""
        return self.n_active * self.pitch

    @property
    def width(self) -> float:
        """Width that the scan lines cover, half a line's distance beyond the outermost included, m."""
        return self.n_lines * self.line_spacing

    @property
    def wavelength(self) -> float:
        """Wavelength at the centre frequency, m."""
        return self.speed_of_sound / self.center_frequency

    @property
    def line_positions(self) -> npt.NDArray[np.float64]:
        """Lateral positions of the scan lines, (n_lines,) m."""
        return np.asarray((np.arange(self.n_lines) - (self.n_lines - 1) / 2) * self.line_spacing)

    @property
    def apodization(self) -> npt.NDArray[np.float64]:
        """Weights of the active elements, (n_active,): MATLAB's `hanning`, without zeros at the ends."""
        return self.window((np.arange(self.n_active) - (self.n_active - 1) / 2) * self.pitch)

    def window(self, positions: npt.NDArray[np.floating]) -> npt.NDArray[np.float64]:
        """Return the apodisation at `positions` (m) from the aperture's centre, within its width."""
        width = (self.n_active + 1) * self.pitch
        return np.asarray(0.5 * (1.0 + np.cos(2.0 * np.pi * positions / width)))

    @property
    def receives_apart(self) -> bool:
        """Whether focus or aperture of the receive are others than those of the transmit."""
        return self.receive_focus is not None or self.receive_f_number is not None

    @property
    def receives_dynamically(self) -> bool:
        """Whether the receive focus follows the echoes."""
        return isinstance(self.receive_focus, str)

    def receive_depths(
        self, focal_depth: float, distances: npt.NDArray[np.floating]
    ) -> npt.NDArray[np.float64]:
        """Return the depths of the receive focus for echoes from `distances` (m) of the line, as many, m."""
        if isinstance(self.receive_focus, str):
            return np.asarray(distances, dtype=np.float64)
        return np.full(np.shape(distances), focal_depth if self.receive_focus is None else self.receive_focus)

    def receive_half_width(self, depths: npt.NDArray[np.floating]) -> npt.NDArray[np.float64]:
        """Return where the receive window about the line is zero, for a receive focus at `depths` (m), m."""
        widths = np.full(np.shape(depths), self.aperture_width)
        if self.receive_f_number is not None:
            widths = np.clip(depths / self.receive_f_number, self.pitch, widths)
        return np.asarray((widths + self.pitch) / 2)

    def aperture_centers(self, line_positions: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return where the centres of the active apertures of lines at (n_lines,) m lie, (n_lines,) m.

        The active elements are the `n_active` nearest to the line; where the array ends, the last ones.
        """
        middle = (self.n_elements - self.n_active) / 2
        first = np.floor(line_positions / self.pitch + middle + 0.5)
        return np.asarray((np.clip(first, 0, self.n_elements - self.n_active) - middle) * self.pitch)

    @property
    def rf_sampling_frequency(self) -> float:
        """Sampling frequency of simulated RF, Hz: the lowest whole fraction that is at least 7 f0."""
        return self.sampling_frequency / math.floor(self.sampling_frequency / (7 * self.center_frequency))

    @property
    def iq_decimation(self) -> int:
        """RF samples per I/Q sample; the I/Q rate is at least 1.4 f0."""
        return math.floor(self.rf_sampling_frequency / (1.4 * self.center_frequency))

    @property
    def iq_sampling_frequency(self) -> float:
        """Sampling frequency of simulated I/Q, Hz."""
        return self.rf_sampling_frequency / self.iq_decimation

    @property
    def iq_center_frequency(self) -> float:
        """Middle of the I/Q's band, Hz, a little below f0.

        Where elevation lets little through at f0, the pulse's weak low frequencies are what is heard.
        """
        return self.center_frequency - 0.1 * self.iq_sampling_frequency

    @cached_property
    def pulse(self) -> npt.NDArray[np.float64]:
        """Excitation convolved with the impulse responses of both ways, (n_samples,), read-only."""
        fs, f0 = self.sampling_frequency, self.center_frequency
        excitation = np.sin(2 * np.pi * f0 * _times(self.excitation_cycles / f0, fs))
        time = _times(self.impulse_response_cycles / f0, fs)
        window = 0.5 * (1.0 - np.cos(2.0 * np.pi * np.arange(1, len(time) + 1) / (len(time) + 1)))
        response = np.sin(2 * np.pi * f0 * time) * window
        pulse = np.convolve(np.convolve(excitation, response), response) / fs**2
        pulse.flags.writeable = False
        return pulse

    def pulse_spectrum(self, frequencies: npt.NDArray[np.floating]) -> npt.NDArray[np.complex128]:
        """Return the Fourier transform of `pulse` at (n_frequencies,) Hz, (n_frequencies,)."""
        time = np.arange(len(self.pulse)) / self.sampling_frequency
        return np.asarray(np.exp(-2j * np.pi * np.outer(frequencies, time)) @ self.pulse)

    @cached_property
    def pulse_delay(self) -> float:
        """Centre of the pulse's energy after its start, s."""
        energy = np.square(self.pulse)
        return float(np.arange(len(energy)) @ energy / energy.sum() / self.sampling_frequency)


def _checked(name: str, value: object) -> int | float | str | None:
    """Return the value of a field as a plain number, or raise TypeError or ValueError."""
    if name in ("receive_focus", "receive_f_number") and value is None:
        return None
    if name == "receive_focus" and isinstance(value, str):
        if value != DYNAMIC:
            raise ValueError(f"receive_focus must be None, a depth in m or {DYNAMIC!r}, not {value!r}.")
        return value
    if name == "receive_f_number":
        return number(name, value, low=0.1, high=100.0)
    if name in _WHOLE:
        return whole_number(name, value, low=1)
    if name in _CYCLES:
        return number(name, value, low=0.25, high=100.0)
    return quantity(name, value, *_BOUNDS[name]) if name == "kerf" else bounded(name, value)


def bounded(name: str, value: object) -> float:
    """Return a length, speed or frequency of a scanner as a float.

    Raises:
        TypeError: If it is no number.
        ValueError: If none has such a one; the message says in which unit it was probably given.
    """
    positive(name, value)
    return quantity(name, value, *_BOUNDS[name])


def _times(duration: float, sampling_frequency: float) -> npt.NDArray[np.float64]:
    """Return sampling times from 0 to at most `duration`, as MATLAB's 0:1/fs:duration gives them."""
    return np.arange(math.floor(duration * sampling_frequency * (1 + 1e-12)) + 1) / sampling_frequency


DEFAULT_ARRAY = LinearArray()


def check_array(array: object) -> None:
    """Raise TypeError if `array` is no `LinearArray`."""
    if not isinstance(array, LinearArray):
        hint = f": usbench.read_probe({array!r}) reads one" if isinstance(array, str) else ""
        raise TypeError(f"array must be of type LinearArray, not {reprlib.repr(array)}{hint}.")
