"""Custom anatomy: a 3-D image as tissue, simulated or sliced."""

from usbench.envs.anatomy.placement import Placement
from usbench.envs.anatomy.recorded import Recording
from usbench.envs.anatomy.simulated import Echogenicity
from usbench.envs.anatomy.tissue import Anatomy

__all__ = ["Anatomy", "Echogenicity", "Placement", "Recording"]
