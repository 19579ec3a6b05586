"""Frames that stand in for the simulator."""

import numpy as np


class CodedFrames:
    """Stands in for the simulator: each frame holds the pose from which it was taken."""

    def has(self, pose):
        return True

    def frame(self, pose):
        frame = np.zeros((90, 40), np.uint8)
        frame[0, :3] = pose.x_mm + 20, pose.focal_depth_mm, pose.angle_deg // 2
        return frame
