"""Slices of a recorded image: where the probe is, however the image lies."""

import math
from pathlib import Path

import numpy as np
import pytest
from volumes import turned

from usbench.envs.anatomy import Placement, Recording
from usbench.envs.anatomy.volume_file import read
from usbench.envs.pose import Pose
from usbench.envs.tasks.probe_plane import PROBE_PLANE

SPINE = Path(__file__).parents[2] / "reference" / "spine_phantom.mha"
SHAPE = (90, 40), 1e-3


@pytest.mark.parametrize("pose", [Pose(0, 50, 0), Pose(-5, 50, 30), Pose(10, 50, 90), Pose(0, 50, 225)])
def test_a_slice_shows_the_image_plane_of_the_probe(image, pose):
    # A linear function: the mean over a pixel is the value at its centre.
    path = image(
        lambda x, y, z: 120 + x + 0.7 * y + 0.8 * z, (45, 45, 40), (2.0, 2.0, 2.0), (-44.0, -44.0, 0.0)
    )
    recording = Recording.read(path)
    frame = recording.recorded_frame(pose, *SHAPE)
    assert frame.shape == (90, 40) and frame.dtype == np.uint8
    angle = math.radians(pose.angle_deg)
    for row, column in [(0, 0), (0, 39), (40, 20), (70, 5), (77, 39)]:
        along, z = column - 19.5, row + 0.5
        x, y = pose.x_mm + along * math.cos(angle), along * math.sin(angle)
        seen = 120 + x + 0.7 * y + 0.8 * z
        assert frame[row, column] == pytest.approx(255 / recording.volume.largest * seen, abs=0.6)
    # The image ends at a depth of 78 mm.
    assert not frame[79:].any() and frame[:78].all()


def test_pixels_are_means_of_what_they_cover(image):
    # Stripes of 0.5 mm: samples one pixel apart would be all black or all white.
    path = image(lambda x, y, z: 200.0 * (np.round(2 * z) % 2), (41, 41, 81), (0.5,) * 3, (-10, -10, 0))
    frame = Recording.read(path).recorded_frame(Pose(0, 50, 0), *SHAPE)
    inside = frame[2:38, 12:28]
    assert inside.min() > 100 and inside.max() < 155


def test_a_turned_image_is_sliced_where_it_lies(image):
    # The same tissue on another grid is the same tissue.
    def tissue(x, y, z):
        return 100 + 60 * np.exp(-(((x - 6) / 12) ** 2) - ((y + 3) / 15) ** 2 - ((z - 40) / 20) ** 2)

    straight = Recording.read(image(tissue, (81, 81, 91), origin=(-40, -40, 0)))
    poses = [Pose(0, 50, 0), Pose(10, 50, 60)]
    expected = [straight.recorded_frame(pose, *SHAPE) for pose in poses]
    size, step = (70, 65, 70), 2.0
    middle = turned() @ (step * (np.array(size) - 1) / 2) - [0, 0, 45]
    path = image(tissue, size, (step,) * 3, (-middle).tolist(), turned())
    zero, _ = Placement().frame(read(path))
    shifted = Placement(center_x_mm=-zero[0], center_y_mm=-zero[1], skin_mm=-zero[2])
    oblique = Recording.read(path, placement=shifted)
    for frame, other in zip(expected, [oblique.recorded_frame(pose, *SHAPE) for pose in poses], strict=True):
        inside = (frame > 0) & (other > 0)
        assert inside.mean() > 0.9
        difference = frame[inside].astype(int) - other[inside].astype(int)
        assert np.abs(difference).max() <= 2


def test_a_recording_of_a_spine_phantom_shows_a_vertebra():
    placement = Placement(center_x_mm=-2.5, skin_mm=5.0)
    recording = Recording.read(SPINE, placement=placement)
    volume = recording.volume
    assert volume.voxels.shape[::-1] == (74, 53, 52) and volume.spacing_mm.tolist() == [1.0] * 3
    assert (volume.voxels > 0).mean() == pytest.approx(0.29, abs=0.005)
    frames = np.array([recording.recorded_frame(pose, *SHAPE) for pose in PROBE_PLANE.states[::10]])
    target = recording.recorded_frame(Pose(0, 50, 0), *SHAPE)
    # Muscle at the skin, the vertebra's shadow below its arch, and the end of the recording.
    assert target[:5, 10:30].mean() > 150 > 20 > target[25:40, 15:25].mean()
    assert not frames[:, 48:].any()
