"""All frames of the task `fp` as they were simulated, for tests in which they are not what is tested.

Their 18 response tables take half a minute. `python tests/support/fp_frames.py` writes them.
"""

import hashlib
from pathlib import Path

import numpy as np

from usbench.setting import Setting

RECORD = Path(__file__).parents[1] / "reference" / "fp_frames.npz"


class FpFrames:
    """Stands in for the simulator in `fp`."""

    def __init__(self):
        with np.load(RECORD) as file:
            self._frames = dict(zip(Setting(task="fp").guidance.states, file["frames"], strict=True))

    def has(self, pose):
        return pose in self._frames

    def frame(self, pose):
        return self._frames[pose]

    def digest(self):
        """Return what trials record of these frames."""
        return hashlib.sha256(b"".join(frame.tobytes() for frame in self._frames.values())).hexdigest()


def main():
    from usbench.envs.frames import frame_store

    setting = Setting(task="fp")
    setting.prepare_frames()
    env = setting.plain_env()
    store = frame_store(env.phantom, env.probe, env.imaging)
    np.savez_compressed(RECORD, frames=np.stack([store.frame(pose) for pose in setting.guidance.states]))


if __name__ == "__main__":
    main()
