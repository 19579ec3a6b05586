"""Quick trials: frames drawn instead of simulated, and a handful of evaluation episodes."""

import dataclasses
import functools
import hashlib

import numpy as np

QUICK_CHECKPOINTS = 2


class DrawnFrames:
    """Stands in for the simulator: a bright spot whose place and width tell the pose."""

    def __init__(self, height_px=90, width_px=40):
        self.shape = height_px, width_px

    def has(self, pose):
        return True

    def frame(self, pose):
        height, width = self.shape
        x, z = np.arange(width)[np.newaxis] - (width - 1) / 2, np.arange(height)[:, np.newaxis]
        width = 3 + 9 * abs(np.cos(np.radians(pose.angle_deg)))
        spot = np.exp(-(((x + pose.x_mm) / width) ** 2) - ((z - pose.focal_depth_mm) / 10) ** 2)
        return (20 + 200 * spot).astype(np.uint8)

    def prepare(self, poses, progress=None):
        for done in range(len(poses)):
            if progress is not None:
                progress(done + 1, len(poses))

    def digest(self, poses):
        return hashlib.sha256(b"".join(self.frame(pose).tobytes() for pose in poses)).hexdigest()


def speed_up(monkeypatch):
    """Make trials take a second or two."""
    # Here, so that the tests of the physics do not wait for the rest.
    from usbench import suite
    from usbench.envs import oracle

    def drawn(_phantom, _probe, imaging):
        return DrawnFrames(imaging.height_px, imaging.width_px)

    for name in ("_returns", "_policy", "_rewards_from_frames"):  # which may be of the simulator's frames
        plain = getattr(oracle, name).__wrapped__
        monkeypatch.setattr(oracle, name, functools.lru_cache(maxsize=256)(plain))
    monkeypatch.setattr("usbench.envs.guidance.frame_store", drawn)
    monkeypatch.setattr("usbench.setting_parts.evaluation_frames.frame_store", drawn)
    monkeypatch.setattr("usbench.trials.tensorboard.frame_store", drawn)
    if suite.TASKS["pp"].checkpoints != QUICK_CHECKPOINTS:  # fixtures may ask for it within each other
        rows = {name: _with_fewer_evaluations(row) for name, row in suite.TASKS.items()}
        monkeypatch.setattr(suite, "TASKS", rows)


def _with_fewer_evaluations(row):
    guidance = dataclasses.replace(row.guidance, starts=row.guidance.starts[::7])
    few = {"drawn_starts": min(row.drawn_starts, 4), "phantoms": min(row.phantoms, 3)}
    return dataclasses.replace(row, repeats=1, checkpoints=QUICK_CHECKPOINTS, guidance=guidance, **few)
