"""What can be examined: the protocols that phantoms and custom anatomies fulfil, each in its own module."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from usbench.envs.phantom import ObjectOfInterest
from usbench.envs.pose import Pose

Array = npt.NDArray[np.float64]


class Scatterers(Protocol):
    """What a scanner needs to make an image.

    Its `repr` says all that its echoes follow from: the noise of the electronics is drawn from it.
    """

    @property
    def attenuation_db_per_cm_mhz(self) -> float:
        """What sound loses on its way, everywhere alike."""

    def in_view(self, pose: Pose, half_width_m: float, half_thickness_m: float) -> tuple[Array, Array]:
        """Return positions (n, 3) m in the probe's coordinate system and amplitudes (n,) of what is seen.

        Seen is what lies in front of the probe, at depths above 0, and within these bounds.

        Args:
            pose: Of the probe.
            half_width_m: How far the view reaches from the probe's centre along the array.
            half_thickness_m: How far it reaches from the image plane.

        Raises:
            ValueError: If the tissue is a recorded image, which has no scatterers.
        """


@runtime_checkable
class Tissue(Scatterers, Protocol):
    """A box of tissue in which an environment sets its task, a frozen value.

    Its `repr` says all that its frames follow from: frames are kept under it.
    """

    def __hash__(self) -> int:
        """Equal tissue is equal: stores of frames are found by it."""

    @property
    def target(self) -> Pose:
        """The pose that shows best what is looked for."""

    @property
    def width_mm(self) -> float:
        """Extent in x, centred at 0."""

    @property
    def height_mm(self) -> float:
        """Extent in y (elevation), centred at 0."""

    @property
    def depth_mm(self) -> float:
        """Extent in z, from 0 down."""

    @property
    def object_of_interest(self) -> ObjectOfInterest | None:
        """What is looked for, None where its outline is not known."""

    @property
    def has_focus(self) -> bool:
        """Whether frames depend on the focal depth and the settings, as those of a recorded image do not."""

    @property
    def shown(self) -> Tissue:
        """This tissue without what changes no frame."""

    def recorded_frame(
        self, pose: Pose, shape: tuple[int, int], pixel_size: float
    ) -> npt.NDArray[np.uint8] | None:
        """Return the frame (height_px, width_px) of a recorded image, None where frames are simulated."""
