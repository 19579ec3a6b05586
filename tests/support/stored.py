"""A scene whose frames are made quickly, for the tests of stored frames."""

from functools import lru_cache

import numpy as np

from usbench.envs import frames
from usbench.envs.bmode import Imaging
from usbench.envs.phantom import Phantom
from usbench.envs.pose import Pose
from usbench.envs.probe import LinearArray

SCENE = (Phantom(), LinearArray(), Imaging())
POSES = [Pose(x, 50, 0) for x in (-5, 0, 5)]


def coded_scan(phantom, pose, array, imaging):
    """Stands in for `scan`: the frame's grey level tells pose and phantom."""
    value = (pose.x_mm + 20 + pose.focal_depth_mm + phantom.seed) % 256
    return np.full((imaging.height_px, imaging.width_px), value, np.uint8)


def fresh_stores(monkeypatch):
    """Let the process begin with no store of frames; those that it has are back at the end."""
    monkeypatch.setattr(frames, "_stores", lru_cache(maxsize=8)(frames.FrameStore))
