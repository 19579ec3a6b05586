"""The frames of an evaluation: simulated before it begins, and known by one digest."""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from usbench.envs.bmode import Imaging
from usbench.envs.frames import frame_store
from usbench.envs.pose import Pose
from usbench.envs.probe import LinearArray
from usbench.envs.tissue import Tissue
from usbench.records import Frames

Report = Callable[[int, int], None]


@dataclass(frozen=True)
class EvaluationFrames:
    """Frames that are simulated before the evaluation's episodes are played.

    Attributes:
        views: The phantoms, each with the poses at which the probe looks at it.
        probe: The transducer.
        imaging: How RF becomes a frame.
    """

    views: tuple[tuple[Tissue, tuple[Pose, ...]], ...]
    probe: LinearArray
    imaging: Imaging

    def prepare(self, report: Report | None = None) -> Frames:
        """Simulate those that are not kept, and return how many there are with one digest of all.

        Args:
            report: Is told how many there are by now, and how many there will be.
        """
        digests, done, total = [], 0, sum(len(poses) for _, poses in self.views)
        for phantom, poses in self.views:
            store = frame_store(phantom, self.probe, self.imaging)
            done += len(poses)
            store.prepare(poses, report and partial(_of_all, report, done, total))
            digests.append(store.digest(poses))
        one = digests[0] if len(digests) == 1 else hashlib.sha256("".join(digests).encode()).hexdigest()
        return Frames(one, total)

    def are_kept(self) -> bool:
        """Return whether `prepare` would find every one of them."""
        return all(
            all(map(frame_store(phantom, self.probe, self.imaging).has, poses))
            for phantom, poses in self.views
        )


def _of_all(report: Report, at_end: int, total: int, done: int, missing: int) -> None:
    """Report how many frames of all phantoms there are: `at_end` when those `missing` of one are `done`."""
    report(at_end - missing + done, total)
