"""Tasks with a new phantom in every episode: an agent is evaluated on phantoms that training never meets."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
import numpy.typing as npt

from usbench.envs.field.response_table import keep_tables
from usbench.envs.frames import keep_stores
from usbench.envs.guidance import GuidanceEnv
from usbench.envs.phantom import Phantom
from usbench.envs.pose import Pose
from usbench.envs.tasks.focal_point import FOCAL_POINT
from usbench.envs.tasks.phantom_distribution import PhantomDistribution, phantom_number
from usbench.envs.tasks.probe_plane import PROBE_PLANE

# Phantoms of a fixed set whose frames stay in memory: 0.8 MB each, once all poses of `pp` are known, and
# up to 14 MB in an examination.
KEPT = 4096


class RandomPhantomEnv(GuidanceEnv):
    """A task with a new phantom in every episode; subclasses are a task's own class beside this one.

    Args:
        phantoms: What phantoms are drawn from; default: the task's own.
        kwargs: As for `GuidanceEnv`, without `phantom`.
    """

    distribution: ClassVar[PhantomDistribution]
    scene = ("phantoms", "probe", "imaging")
    phantom: Phantom

    def __init__(self, *, phantoms: PhantomDistribution | None = None, **kwargs: Any) -> None:
        """Check the configuration; the first phantom comes with the first reset.

        Raises:
            TypeError: If `phantom` is given, or an argument has the wrong type.
            ValueError: If a value is not allowed.
        """
        if "phantom" in kwargs:
            raise TypeError("phantom is drawn anew in every episode: pass phantoms, what it is drawn from.")
        if phantoms is not None and not isinstance(phantoms, PhantomDistribution):
            raise TypeError(f"phantoms must be of type PhantomDistribution, not {phantoms!r}.")
        super().__init__(**kwargs)
        self.phantoms = phantoms or self.distribution
        keep_tables(len({pose.focal_depth_mm for pose in self.task.states}))
        if self.phantoms.count is not None:
            keep_stores(min(self.phantoms.count, KEPT))

    def start(self, seed: int | None = None, options: Mapping[str, Any] | None = None) -> None:
        """Draw a phantom and put the probe on a start pose.

        Args:
            seed: As in `GuidanceEnv.reset`.
            options: As there, and "phantom", the number of the phantom in place of the drawn one: below
                2**31 those of training, from there to 2**32 - 1 those kept for evaluation.

        Raises:
            TypeError: If an option is not a number.
            ValueError: If an option is unknown, not a whole number or out of range.
        """
        chosen = self._checked(options)
        super(GuidanceEnv, self).reset(seed=seed)
        # Drawn even where options replace it, so that they do not shift the stream.
        number = self.phantoms.training_number(self.np_random)
        self.phantom = self.phantoms.phantom(chosen.pop("phantom", number))
        self.target = self.phantom.target
        self._frames = None
        super().start(options=chosen)

    def state_rewards(self) -> npt.NDArray[np.float64]:
        """Return the reward of every state with the phantom of this episode, as in `GuidanceEnv`.

        Raises:
            gymnasium.error.ResetNeeded: Before the first reset, which draws the phantom.
        """
        if self._pose is None:
            raise gym.error.ResetNeeded("call reset() first: there is no phantom before.")
        return super().state_rewards()

    @property
    def _options(self) -> tuple[str, ...]:
        return (*super()._options, "phantom")

    def _checked(self, options: Mapping[str, Any] | None) -> dict[str, Any]:
        if not isinstance(options, Mapping) or "phantom" not in options:
            return super()._checked(options)
        coordinates = {name: value for name, value in options.items() if name != "phantom"}
        return super()._checked(coordinates) | {"phantom": phantom_number(options["phantom"])}

    def _info(self, displaced: dict[str, int]) -> dict[str, Any]:
        return {**super()._info(displaced), "phantom": self.phantom.seed, **self._target_info()}


_ANGLES = tuple(range(0, 360, 15))

FOCAL_POINT_RANDOM = replace(FOCAL_POINT, name="fp-random", title="Focal point, new phantoms")
PROBE_PLANE_RANDOM = replace(
    PROBE_PLANE,
    name="pp-random",
    title="Probe plane, new phantoms",
    # The object's plane may have any angle, so the probe begins with any.
    starts=tuple(Pose(x_mm, 50, angle) for x_mm in range(-15, 16, 5) for angle in _ANGLES),
)
PROBE_PLANE_TRACKED = replace(
    PROBE_PLANE_RANDOM, name="pp-tracked", title="Probe plane, new phantoms, tracked probe"
)


class FocalPointRandomEnv(RandomPhantomEnv):
    """Find the position of the probe and the depth of its focus, in an unseen phantom.

    ## Description
    The task of `FocalPointEnv` with a new phantom in every episode: other speckle, and an object of another
    size and contrast at another place and in another orientation. What an agent knows by heart of one
    phantom helps it little here.

    ## Action Space
    As in `FocalPointEnv`.

    ## Observation Space
    As in `FocalPointEnv`; `info` also holds `phantom`, the number from which the phantom follows, and the
    pose that shows its object best: `target_x_mm`, `target_focal_depth_mm`, `target_angle_deg`.

    ## Rewards
    As in `FocalPointEnv`, relative to the object of the episode.

    ## Episode End
    As in `FocalPointEnv`; `reset(options={"phantom": ...})` chooses the phantom.

    ## Arguments
    As in `FocalPointEnv`, with `phantoms` (`PhantomDistribution`) in place of `phantom`: by default the
    object lies at x in {-10, -5, .., 10} mm and a depth in {35, 40, .., 65} mm, turned by any multiple of 15
    degrees.
    """

    task = FOCAL_POINT_RANDOM
    distribution = PhantomDistribution(tuple(range(-10, 11, 5)), tuple(range(35, 66, 5)), _ANGLES)


class ProbePlaneRandomEnv(RandomPhantomEnv):
    """Find the position and the rotation of the probe, in an unseen phantom.

    ## Description
    The task of `ProbePlaneEnv` with a new phantom in every episode: other speckle, and an object of another
    size and contrast at another place and in another orientation. What an agent knows by heart of one
    phantom helps it little here.

    ## Action Space
    As in `ProbePlaneEnv`.

    ## Observation Space
    As in `ProbePlaneEnv`; `info` also holds `phantom`, the number from which the phantom follows, and the
    pose that shows its object best: `target_x_mm`, `target_focal_depth_mm`, `target_angle_deg`.

    ## Rewards
    As in `ProbePlaneEnv`, relative to the object of the episode.

    ## Episode End
    As in `ProbePlaneEnv`, with every multiple of 15 degrees as a start; `reset(options={"phantom": ...})`
    chooses the phantom.

    ## Arguments
    As in `ProbePlaneEnv`, with `phantoms` (`PhantomDistribution`) in place of `phantom`: by default the
    object lies at x in {-10, -5, .., 10} mm and a depth in {40, 45, .., 60} mm, turned by any multiple of 15
    degrees.
    """

    task = PROBE_PLANE_RANDOM
    distribution = PhantomDistribution(tuple(range(-10, 11, 5)), tuple(range(40, 61, 5)), _ANGLES)


class ProbePlaneTrackedEnv(ProbePlaneRandomEnv):
    """Find the position and the rotation of a tracked probe, in an unseen phantom.

    ## Description
    The task of `ProbePlaneRandomEnv`, and the agent is told where its probe is and how it is turned, as
    trackers tell it in practice. But for speckle, one frame of that task looks the same from four
    poses, which need opposite actions; the probe's heading nearly tells which of them it is.

    ## Action Space
    As in `ProbePlaneRandomEnv`.

    ## Observation Space
    `Dict(image, senses)`: `image` as in `ProbePlaneRandomEnv`, and `senses`, `Box(-1, 1, (3,), float32)`:
    x / 20 mm, sine and cosine of the probe's angle. Nothing is told of the object.

    ## Rewards
    As in `ProbePlaneRandomEnv`.

    ## Episode End
    As in `ProbePlaneRandomEnv`.

    ## Arguments
    As in `ProbePlaneRandomEnv`; `senses` are `("position", "heading")` by default.
    """

    task = PROBE_PLANE_TRACKED
    default_senses = ("position", "heading")
