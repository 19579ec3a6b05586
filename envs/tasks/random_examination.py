"""The examination with a new phantom in every episode, with and without a tracked probe."""

from __future__ import annotations

from dataclasses import replace

from usbench.envs.tasks.examination import EXAMINATION
from usbench.envs.tasks.random_phantoms import FocalPointRandomEnv, RandomPhantomEnv

EXAMINATION_RANDOM = replace(EXAMINATION, name="exam-random", title="Examination, new phantoms")
EXAMINATION_TRACKED = replace(
    EXAMINATION, name="exam-tracked", title="Examination, new phantoms, tracked probe"
)


class ExaminationRandomEnv(RandomPhantomEnv):
    """Find the position, the focal depth and the rotation that show the object best, in an unseen phantom.

    ## Description
    The task of `ExaminationEnv` with a new phantom in every episode: other speckle, and an object of another
    size and contrast at another place and in another orientation.

    ## Action Space
    As in `ExaminationEnv`.

    ## Observation Space
    As in `ExaminationEnv`; `info` also holds `phantom`, the number from which the phantom follows, and the
    pose that shows its object best: `target_x_mm`, `target_focal_depth_mm`, `target_angle_deg`.

    ## Rewards
    As in `ExaminationEnv`, relative to the object of the episode.

    ## Episode End
    As in `ExaminationEnv`; `reset(options={"phantom": ...})` chooses the phantom.

    ## Arguments
    As in `ExaminationEnv`, with `phantoms` (`PhantomDistribution`) in place of `phantom`: by default the
    object lies at x in {-10, -5, .., 10} mm and a depth in {35, 40, .., 65} mm, turned by any multiple of 15
    degrees.
    """

    task = EXAMINATION_RANDOM
    distribution = FocalPointRandomEnv.distribution


class ExaminationTrackedEnv(ExaminationRandomEnv):
    """Find the best position, focal depth and rotation of a tracked probe, in an unseen phantom.

    ## Description
    The task of `ExaminationRandomEnv`, and the agent is told where its probe is, how deep it focuses and how
    it is turned, as a tracker and the scanner itself tell it in practice.

    ## Action Space
    As in `ExaminationRandomEnv`.

    ## Observation Space
    `Dict(image, senses)`: `image` as in `ExaminationRandomEnv`, and `senses`, `Box(-1, 1, (4,), float32)`:
    x / 20 mm, focal depth / 90 mm, sine and cosine of the probe's angle. Nothing is told of the object.

    ## Rewards
    As in `ExaminationRandomEnv`.

    ## Episode End
    As in `ExaminationRandomEnv`.

    ## Arguments
    As in `ExaminationRandomEnv`; `senses` are `("position", "focus", "heading")` by default.
    """

    task = EXAMINATION_TRACKED
    default_senses = ("position", "focus", "heading")
