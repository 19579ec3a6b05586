"""The imaging-setup task: the probe stands still, and the scanner's settings are to show a cyst best.

Quality is the contrast-to-noise ratio of the frame as it is displayed: the agent sees the frame alone, the
reward knows where the cyst is. The first version of the task has neither noise of the electronics nor time
gain compensation; everything else is the same in both.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NoReturn, cast

import numpy as np

from usbench.envs.bmode import Imaging
from usbench.envs.guidance import GuidanceEnv
from usbench.envs.phantom import ObjectOfInterest, Phantom
from usbench.envs.pose import Limits, Move, Pose, cos_deg, sin_deg
from usbench.envs.settings import Setup, tuned
from usbench.envs.task import Action, Task
from usbench.envs.tasks.image_quality import (
    Mask,
    contrast_order,
    contrast_to_noise,
    generalized_contrast_to_noise,
)

# Soft tissue with speckle everywhere but in the object: a cyst, which echoes nothing.
PHANTOM = Phantom(
    object_of_interest=ObjectOfInterest(contrast=0.0),
    tissue_density_per_mm3=Phantom().object_density_per_mm3,
    attenuation_db_per_cm_mhz=0.5,
)
# A receiver with noise, and the gain that undoes the attenuation at 3 MHz, there and back.
IMAGING = Imaging(noise_db=40.0, tgc_db_per_cm=2 * 0.5 * 3.0)
# Standard deviations between the mean grey levels of cyst and tissue from which on an image is good.
GOOD = 2.0


def regions(phantom: Phantom, pose: Pose, imaging: Imaging) -> tuple[Mask, Mask]:
    """Return which pixels (height_px, width_px) lie in the object, and which beside it at the same depths."""
    lateral_mm, depth_mm = (
        ((np.arange(n) + 0.5) * imaging.pixel_size - shift) * 1e3
        for n, shift in (
            (imaging.width_px, imaging.width_px / 2 * imaging.pixel_size),
            (imaging.height_px, 0.0),
        )
    )
    u, z = (grid.ravel() for grid in np.meshgrid(lateral_mm, depth_mm))
    points = np.stack([pose.x_mm + cos_deg(pose.angle_deg) * u, sin_deg(pose.angle_deg) * u, z], axis=1)
    inside = np.any([ball.contains(points) for ball in phantom.object_of_interest.balls], axis=0)
    inside = inside.reshape(imaging.height_px, imaging.width_px)
    return inside, inside.any(axis=1, keepdims=True) & ~inside


def reward(pose: Pose, target: Pose, kind: str) -> NoReturn:
    """Raise TypeError: the reward follows from frames, see `ImagingSetupEnv.state_rewards`."""
    raise TypeError("the reward of the task 'setup' follows from frames: ask its environment for it.")


def is_success(pose: Pose, target: Pose) -> NoReturn:
    """Raise TypeError: success follows from frames."""
    raise TypeError("success in the task 'setup' follows from frames: ask its environment for it.")


def distance_mm(pose: Pose, target: Pose) -> float:
    """Return how far the focus is from the object's depth."""
    return float(abs(pose.focal_depth_mm - target.focal_depth_mm))


_STATES = tuple(
    Setup(0, depth_mm, 0, frequency_khz=frequency_khz, dynamic_range_db=range_db)
    for frequency_khz in range(2_000, 5_001, 1_000)
    for depth_mm in range(30, 81, 10)
    for range_db in range(20, 91, 10)
)
_MOVES = (
    Move(focal_depth_mm=-10),
    Move(focal_depth_mm=10),
    Move(frequency_khz=-1_000),
    Move(frequency_khz=1_000),
    Move(dynamic_range_db=-10),
    Move(dynamic_range_db=10),
)
_NAMES = ("focus up", "focus down", "frequency down", "frequency up", "range narrower", "range wider")

IMAGING_SETUP = Task(
    name="setup",
    title="Imaging setup",
    actions=(Action("stay", Move()), *map(Action, _NAMES, _MOVES)),
    starts=_STATES,
    displacements=_MOVES,
    states=_STATES,
    reward=reward,
    is_success=is_success,
    distance_mm=distance_mm,
    limits=Limits(focal_depth_mm=(30, 80), frequency_khz=(2_000, 5_000), dynamic_range_db=(20, 90)),
    rewards=("normalized",),
    reward_from_frames=True,
)
IMAGING_SETUP_V0 = replace(
    IMAGING_SETUP, name="setup-v0", title="Imaging setup without receiver noise or gain"
)


class ImagingSetupEnv(GuidanceEnv):
    """Find the focal depth, the centre frequency and the dynamic range that show a cyst best.

    ## Description
    A linear array stands still over soft tissue that attenuates by 0.5 dB/cm/MHz, with a cyst in it: the
    object of the other tasks, dark in place of bright. The receiver's electronics add noise, 40 dB below the
    echo of a unit point at 50 mm, and time gain compensation amplifies by 3 dB per cm of depth. The agent
    sees the B-mode frame alone and chooses three settings of the scanner. High frequencies resolve more, but
    sink into the noise sooner; a focus at the cyst makes its edges sharp and the tissue beside it louder than
    the noise; a narrow dynamic range turns weak echoes black, a wide one makes all grey levels similar. With
    probability `noise` a setting changes by one step after an action.

    ## Action Space
    `Discrete(7)`: 0 stay, 1 focus up (10 mm shallower), 2 focus down (10 mm deeper), 3 frequency down (by 1
    MHz), 4 frequency up, 5 range narrower (by 10 dB), 6 range wider. The focus stays in [30, 80] mm, the
    frequency in [2, 5] MHz and the range in [20, 90] dB: a move beyond is not made.

    ## Observation Space
    `Box(0, 255, (height_px, width_px, 1), uint8)`: the B-mode frame (depth, lateral, channel), its size and
    pixels those of `imaging`; by default (90, 40, 1) and 1 mm. The truth is in `info` only: `x_mm`,
    `focal_depth_mm`, `angle_deg`, `frequency_khz`, `dynamic_range_db`; of the frame `contrast_to_noise`,
    `gcnr` (generalized contrast-to-noise ratio, in [0, 1]) and `contrast_order` (in [-1, 1], negative where
    the cyst is darker); `distance_mm` (from the focus to the depth of the cyst), `sin_angle`, `noise` (which
    setting changed and by how much, 0 if blocked at its end) and `is_success` (a contrast-to-noise ratio of
    at least 2).

    ## Rewards
    The contrast-to-noise ratio of cyst and tissue beside it, of the frame after the action and before the
    noise: |m_i - m_o| / sqrt(s_i^2 + s_o^2), with mean and standard deviation of the displayed grey levels
    (Patterson and Foster 1983). The only kind is `"normalized"`: divided by the spread of the grey levels.

    ## Episode End
    Truncated after 16 steps, never terminated. Starts: every combination of the settings;
    `reset(options={"focal_depth_mm": ..., "frequency_khz": ..., "dynamic_range_db": ...})` sets any of them,
    "x_mm" and "angle_deg" too.

    ## Arguments
    `noise` (probability, default 0), `reward` ("normalized"), `phantom` (`Phantom`, its object the cyst),
    `probe` (`LinearArray`) and `imaging` (`Imaging`; another one replaces noise and gain, too), whose
    frequency and dynamic range give way to the settings, `render_mode` (None or "rgb_array"), `senses` (what
    is told beside the frame, such as `("actions",)`; `()` for nothing,
    None for the task's own).

    ## Version History
    v1: noise of the electronics and time gain compensation. v0, the first version, has neither:
    `usbench/ImagingSetup-v0` still gives its frames and rewards.
    """

    task = IMAGING_SETUP
    default_phantom = PHANTOM
    default_imaging = IMAGING

    def __init__(self, **kwargs: Any) -> None:
        """Check the configuration, and that the frames show the object at frequencies that the probe has.

        Raises:
            TypeError: If an argument has the wrong type.
            ValueError: If a value is not allowed, the image shows nothing of the object or of the tissue
                beside it, or the probe cannot be set to a frequency of the task.
        """
        super().__init__(**kwargs)
        self._masks: dict[tuple[int, int], tuple[Mask, Mask]] = {}
        if not all(mask.any() for mask in self._regions(self.task.states[0])):
            size = f"{1e3 * self.imaging.depth:g} mm deep and {1e3 * self.imaging.width:g} mm wide"
            raise ValueError(
                f"imaging must show the object and the tissue beside it, which the task {self.task.name!r} "
                f"compares, and an image {size} does not."
            )
        for frequency_khz in self.task.limits.frequency_khz:
            try:
                tuned(Setup(frequency_khz=frequency_khz), self.probe, self.imaging)
            except ValueError as error:
                raise ValueError(
                    f"the task {self.task.name!r} sets the probe to {frequency_khz / 1e3:g} MHz: {error}"
                ) from error

    def _quality(self, pose: Pose) -> float:
        return contrast_to_noise(self._frame(pose), *self._regions(pose))

    def _regions(self, pose: Pose) -> tuple[Mask, Mask]:
        place = pose.x_mm, pose.angle_deg
        if place not in self._masks:
            # Tissue whose object has no outline is refused.
            self._masks[place] = regions(cast(Phantom, self.phantom), pose, self.imaging)
        return self._masks[place]

    def _reward(self, pose: Pose) -> float:
        return self._quality(pose)

    def _is_success(self, pose: Pose) -> bool:
        return self._quality(pose) >= GOOD

    def _info(self, displaced: dict[str, int]) -> dict[str, Any]:
        frame, masks = self._frame(self.pose), self._regions(self.pose)
        return {
            **super()._info(displaced),
            "contrast_to_noise": contrast_to_noise(frame, *masks),
            "gcnr": generalized_contrast_to_noise(frame, *masks),
            "contrast_order": contrast_order(frame, *masks),
        }


class ImagingSetupV0Env(ImagingSetupEnv):
    """The first version of `ImagingSetupEnv`: without noise of the electronics and time gain compensation.

    ## Description
    As `ImagingSetupEnv`, but the receiver adds no noise and amplifies all depths alike: deep tissue is dark,
    and one sees as deep as echoes stay within the dynamic range. This version is kept so that its results
    can be reproduced; `usbench/ImagingSetup-v1` replaces it.

    ## Action Space
    As in `ImagingSetupEnv`.

    ## Observation Space
    As in `ImagingSetupEnv`.

    ## Rewards
    As in `ImagingSetupEnv`.

    ## Episode End
    As in `ImagingSetupEnv`.

    ## Arguments
    As in `ImagingSetupEnv`.
    """

    task = IMAGING_SETUP_V0
    default_imaging = Imaging()
