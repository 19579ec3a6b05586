"""Attenuation, by exp(-b f d) over a distance d: how much of it can be simulated, and its units."""

from __future__ import annotations

import math
from typing import Any

from usbench.checks import non_negative, plain

# dB / (cm MHz). Beyond, much of what is left of an echo lies below the band that is simulated; the errors are
# in docs/physics.md.
LARGEST = 1.0
_NAME = "attenuation_db_per_cm_mhz"


def checked_attenuation(value: Any) -> float:
    """Return an attenuation in dB / (cm MHz) as a float.

    Raises:
        TypeError: If it is no number.
        ValueError: If it is negative, or larger than echoes can be simulated with.
    """
    found = non_negative(_NAME, value)
    if found > LARGEST:
        raise ValueError(
            f"{_NAME} must be in [0, {plain(LARGEST)}], beyond which simulated echoes are wrong (soft tissue "
            f"has 0.3 to 0.7), not {plain(found)}."
        )
    return found


def nepers_per_m_hz(attenuation_db_per_cm_mhz: float) -> float:
    """Return the same in Np / (m Hz)."""
    return attenuation_db_per_cm_mhz * math.log(10) / 20 * 100 / 1e6
