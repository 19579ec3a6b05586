"""A user's own anatomy: scatterers as strong as the image, slices where the probe is, and what is refused."""

import dataclasses
import math
import pickle

import gymnasium as gym
import numpy as np
import pytest
import SimpleITK as sitk
from volumes import block, of_world, turned, write

from usbench.envs import anatomy
from usbench.envs.anatomy import Echogenicity, Recording
from usbench.envs.bmode import Imaging
from usbench.envs.frames import FrameStore
from usbench.envs.placement import Placement
from usbench.envs.pose import Pose
from usbench.envs.probe import LinearArray
from usbench.envs.probe_plane import PROBE_PLANE

ARRAY, IMAGING = LinearArray(), Imaging()


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """80 x 60 x 90 mm of tissue, 60 .. 140 from left to right."""
    return block(tmp_path_factory.mktemp("volumes") / "block.mha")


@pytest.fixture
def image(tmp_path):
    """`image(value, ..)`: the file of a function of the world."""

    def make(value, *args, **kwargs):
        sitk.WriteImage(of_world(value, *args, **kwargs), str(tmp_path / "image.mha"))
        return tmp_path / "image.mha"

    return make


# Slices.


@pytest.mark.parametrize("pose", [Pose(0, 50, 0), Pose(-5, 50, 30), Pose(10, 50, 90), Pose(0, 50, 225)])
def test_a_slice_shows_the_image_plane_of_the_probe(image, pose):
    # A linear function: the mean over a pixel is the value at its centre.
    path = image(
        lambda x, y, z: 120 + x + 0.7 * y + 0.8 * z, (45, 45, 40), (2.0, 2.0, 2.0), (-44.0, -44.0, 0.0)
    )
    recording = Recording.read(path)
    (frame,) = recording.frames([pose], ARRAY, IMAGING)
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
    (frame,) = Recording.read(path).frames([Pose(0, 50, 0)], ARRAY, IMAGING)
    inside = frame[2:38, 12:28]
    assert inside.min() > 100 and inside.max() < 155


def test_a_turned_image_is_sliced_where_it_lies(image):
    # The same tissue on another grid is the same tissue.
    def tissue(x, y, z):
        return 100 + 60 * np.exp(-(((x - 6) / 12) ** 2) - ((y + 3) / 15) ** 2 - ((z - 40) / 20) ** 2)

    straight = Recording.read(image(tissue, (81, 81, 91), origin=(-40, -40, 0)))
    poses = [Pose(0, 50, 0), Pose(10, 50, 60)]
    expected = straight.frames(poses, ARRAY, IMAGING)
    size, step = (70, 65, 70), 2.0
    middle = turned() @ (step * (np.array(size) - 1) / 2) - [0, 0, 45]
    path = image(tissue, size, (step,) * 3, (-middle).tolist(), turned())
    zero, _ = Placement().frame(anatomy.read(path))
    shifted = Placement(center_x_mm=-zero[0], center_y_mm=-zero[1], skin_mm=-zero[2])
    oblique = Recording.read(path, placement=shifted)
    for frame, other in zip(expected, oblique.frames(poses, ARRAY, IMAGING), strict=True):
        inside = (frame > 0) & (other > 0)
        assert inside.mean() > 0.9
        difference = frame[inside].astype(int) - other[inside].astype(int)
        assert np.abs(difference).max() <= 2


# Scatterers.


def test_scatterers_are_as_strong_as_the_image_is_bright(image):
    path = image(lambda x, y, z: 60 + 50 * np.sign(x), (81, 81, 91), origin=(-40, -40, 0))
    tissue = Echogenicity.read(path)
    positions, amplitudes = anatomy._scatterers(tissue)
    # Half the image is 110 and half is 10, one plane of voxels between them; all of the box is in it.
    assert len(positions) == round(tissue.density_per_mm3 * 80 * 80 * 90)
    dark, bright = amplitudes[positions[:, 0] < -1e-3], amplitudes[positions[:, 0] > 1e-3]
    # The error of a standard deviation is 1 / sqrt(2 n): five of them.
    for values, strength in ((dark, 10 / 110), (bright, 1.0)):
        assert values.std() == pytest.approx(strength, rel=5 / math.sqrt(2 * len(values)))
        assert abs(values.mean()) < 5 * strength / math.sqrt(len(values))
    # Normal: the fourth moment is three times the square of the second, with an error of sqrt(96 / n).
    kurtosis = np.mean(bright**4) / np.mean(bright**2) ** 2
    assert kurtosis == pytest.approx(3, abs=5 * math.sqrt(96 / len(bright)))


def test_between_voxels_the_strength_is_interpolated(image):
    # From 0 to 100 over 20 mm: the variance is the square of the distance.
    path = image(lambda x, y, z: 5.0 * x, (5, 17, 19), (5.0, 5.0, 5.0), (0, -40, 0))
    tissue = Echogenicity.read(path, placement=Placement(center_x_mm=-10.0), density_per_mm3=1.0)
    positions, amplitudes = anatomy._scatterers(tissue)
    x_mm = positions[:, 0] * 1e3
    for low in range(1, 20):
        part = amplitudes[(x_mm >= low) & (x_mm < low + 1)]
        expected = ((low + 1) ** 3 - low**3) / 3 / 20**2
        assert np.mean(part**2) == pytest.approx(expected, rel=5 * math.sqrt(2 / len(part)) + 0.01)
    assert x_mm.min() > 0 and x_mm.max() < 20


def test_decibels_become_strengths(image):
    path = image(lambda x, y, z: 50 + 50.0 * (x > 0), (81, 81, 91), origin=(-40, -40, 0))
    positions, amplitudes = anatomy._scatterers(Echogenicity.read(path, dynamic_range_db=60))
    dark = amplitudes[positions[:, 0] < -1e-3]
    # Half of the shade is half of the decibels.
    assert 20 * np.log10(dark.std()) == pytest.approx(-30, abs=0.2)


def test_there_are_none_where_the_image_is_black_or_ends(image):
    path = image(lambda x, y, z: 9.0 * (z > 20), (21, 21, 41), origin=(-10, -10, 0))
    positions, _ = anatomy._scatterers(Echogenicity.read(path))
    expected = 20 * 20 * 20 * 10_000 / 36_000
    assert len(positions) == pytest.approx(expected, abs=5 * math.sqrt(expected))
    low, high = positions.min(axis=0) * 1e3, positions.max(axis=0) * 1e3
    assert (low > [-10, -10, 20]).all() and (high < [10, 10, 40]).all()


def test_speckle_is_the_seeds_and_fixed_to_the_tissue(file):
    one = Echogenicity.read(file, seed=3)
    again, other = Echogenicity.read(file, seed=3, target=Pose(5, 40, 0)), Echogenicity.read(file, seed=4)
    for mine, its in zip(one.in_view(Pose(5, 50, 30)), again.in_view(Pose(5, 50, 30)), strict=True):
        np.testing.assert_array_equal(mine, its)
    assert not np.array_equal(one.in_view(Pose())[1][:100], other.in_view(Pose())[1][:100])
    # What two poses see alike are the same scatterers.
    pose, moved = Pose(0, 50, 0), Pose(5, 50, 0)
    here, there = ({*one.in_view(where)[1].tolist()} for where in (pose, moved))
    assert 0.8 < len(here & there) / len(here) < 0.95  # 35 mm of 40
    positions, _ = one.in_view(pose)
    assert (np.abs(positions) <= [0.020, 0.005, 0.090]).all()


def test_the_simulator_shows_the_image(image):
    # A ball 20 dB above the tissue around, to the right of the middle.
    def tissue(x, y, z):
        return np.where((x - 6) ** 2 + y**2 + (z - 45) ** 2 < 8**2, 100.0, 10.0)

    path = image(tissue, (81, 41, 91), origin=(-40, -20, 0))
    (frame,) = Echogenicity.read(path).frames([Pose(0, 50, 0)], ARRAY, IMAGING)
    decibels = frame.astype(float) / 255 * 60
    row, column = np.mgrid[0:90, 0:40]
    distance = np.hypot(column - 19.5 - 6, row + 0.5 - 45)
    around = (distance > 12) & (np.abs(row - 45) < 12)
    # Speckle has the same mean in decibels above and below; side lobes fill the tissue around a little.
    assert decibels[distance < 5].mean() - decibels[around].mean() == pytest.approx(20, abs=4)


# Files.


def test_an_anatomy_is_its_content(file, tmp_path):
    one = Recording.read(file, target=Pose(5, 50, 30))
    copy = tmp_path / "copy.nrrd"
    sitk.WriteImage(sitk.ReadImage(str(file)), str(copy))
    other = Recording.read(copy, target=Pose(5, 50, 30))
    assert one == other and hash(one) == hash(other) and one.path != other.path
    stores = [FrameStore(phantom, ARRAY, IMAGING) for phantom in (one, other)]
    assert stores[0].path == stores[1].path
    settings = [
        {"target": Pose(0, 50, 30)},
        {"placement": Placement(skin_mm=1.0)},
        {"digest": "0" * 64},
    ]
    different = [dataclasses.replace(one, **change) for change in settings]
    different += [Echogenicity.read(file), Echogenicity.read(file, seed=1)]
    paths = {FrameStore(phantom, ARRAY, IMAGING).path for phantom in (one, *different)}
    assert len(paths) == 1 + len(different)


def test_a_file_that_changed_is_never_taken_for_what_it_was(tmp_path):
    path = write(tmp_path / "image.mha", np.full((90, 80, 80), 100, np.uint8))
    recording = Recording.read(path)
    (before,) = recording.frames([Pose()], ARRAY, IMAGING)
    write(path, np.full((90, 80, 80), 101, np.uint8))
    # This process has read it; another one would have to now.
    np.testing.assert_array_equal(recording.frames([Pose()], ARRAY, IMAGING)[0], before)
    anatomy._volume.cache_clear()
    with pytest.raises(
        ValueError, match=r"image.mha' has been changed: its digest must be \w{16}, not \w{16}"
    ):
        recording.frames([Pose()], ARRAY, IMAGING)
    assert Recording.read(path) != recording
    path.unlink()
    with pytest.raises(FileNotFoundError, match="there is no volume"):
        dataclasses.replace(recording, digest="1" * 64).frames([Pose()], ARRAY, IMAGING)


def test_a_pickled_anatomy_is_its_configuration(file):
    tissue = Echogenicity.read(file)
    tissue.in_view(Pose())
    content = pickle.dumps(tissue)
    assert len(content) < 1000 and pickle.loads(content) == tissue


# The target and other settings.


@pytest.mark.parametrize("x_mm", [-41, 41])
def test_a_target_beside_the_image_is_refused(file, x_mm):
    with pytest.raises(ValueError, match=rf"target's x_mm must be in \[-40, 40\], .* not {x_mm}"):
        Recording.read(file, target=Pose(x_mm, 50, 0))


def test_a_target_below_the_image_is_refused_where_there_is_a_focus(file):
    placement = Placement(skin_mm=30.0)
    Recording.read(file, target=Pose(0, 61, 0), placement=placement)
    Echogenicity.read(file, target=Pose(0, 60, 0), placement=placement)
    with pytest.raises(ValueError, match=r"focal_depth_mm must be in \[0, 60\], .* not 61"):
        Echogenicity.read(file, target=Pose(0, 61, 0), placement=placement)


@pytest.mark.parametrize("placement", [Placement(center_y_mm=31.0), Placement(skin_mm=-95.0)])
def test_an_image_that_the_probe_misses_is_refused(file, placement):
    with pytest.raises(ValueError, match="center_y_mm and skin_mm"):
        Recording.read(file, target=Pose(), placement=placement)


@pytest.mark.parametrize(
    ("settings", "error", "said"),
    [
        ({"seed": -1}, ValueError, "seed .* not -1"),
        ({"seed": 1.5}, ValueError, "seed .* not 1.5"),
        ({"density_per_mm3": 0.0}, ValueError, "above 0 and at most 10, not 0"),
        ({"density_per_mm3": 11}, ValueError, "above 0 and at most 10, not 11"),
        ({"density_per_mm3": "many"}, TypeError, "density_per_mm3 must be a number, not 'many'"),
        ({"dynamic_range_db": 0}, ValueError, "dynamic_range_db must be positive, or None, not 0"),
        ({"dynamic_range_db": "60 dB"}, TypeError, "dynamic_range_db must be a number, not '60 dB'"),
        ({"placement": Placement("x", "-x")}, ValueError, "right angles, not 'x' and '-x'"),
    ],
)
def test_settings_that_cannot_be_are_refused(file, settings, error, said):
    with pytest.raises(error, match=said):
        Echogenicity.read(file, **settings)


# The environment.


def test_the_environment_examines_it(file):
    recording = Recording.read(file, target=Pose(10, 50, 30))
    env = gym.make("usbench/ProbePlane-v0", phantom=recording, render_mode="rgb_array")
    frame, info = env.reset(seed=1, options={"x_mm": 5, "angle_deg": 45})
    np.testing.assert_array_equal(frame[:, :, 0], recording.frames([Pose(5, 50, 45)], ARRAY, IMAGING)[0])
    assert [info[f"target_{name}"] for name in ("x_mm", "focal_depth_mm", "angle_deg")] == [10, 50, 30]
    assert info["distance_mm"] == 5 and info["sin_angle"] == pytest.approx(math.sin(math.radians(15)))
    _, reward, *_ = env.step(2)
    assert reward == pytest.approx(-math.sin(math.radians(15)))
    _, reward, _, _, info = env.step(3)
    assert reward == 0 and info["is_success"]
    assert env.render().shape == (580, 1240, 3)


@pytest.mark.parametrize("name", ["FocalPoint", "Examination", "ExaminationStop"])
def test_a_recording_has_no_focus_to_be_moved(file, name):
    with pytest.raises(ValueError, match="a recorded image has a focus of its own"):
        gym.make(f"usbench/{name}-v0", phantom=Recording.read(file))
    assert gym.make(f"usbench/{name}-v0", phantom=Echogenicity.read(file)).unwrapped.target == Pose()


def test_a_reward_from_the_image_of_another_object_is_refused(file):
    with pytest.raises(ValueError, match="reward must be one of 'normalized', 'paper' in an anatomy"):
        gym.make("usbench/ProbePlane-v0", phantom=Recording.read(file), reward="image")


@pytest.mark.parametrize("phantom", ["block.mha", Recording, 3])
def test_what_is_no_phantom_is_refused(phantom):
    with pytest.raises(TypeError, match="phantom must be of type Phantom"):
        gym.make("usbench/ProbePlane-v0", phantom=phantom)


# The real one.


def test_the_spine_phantom_is_what_its_readme_says(plus):
    placement = Placement(center_x_mm=-2.5, skin_mm=5.0)
    recording = Recording.read(plus / "SpinePhantomFreehandReconstructed.mha", placement=placement)
    volume = recording.volume
    assert volume.voxels.shape[::-1] == (147, 106, 104) and volume.spacing_mm.tolist() == [0.5] * 3
    assert (volume.voxels > 0).mean() == pytest.approx(0.29, abs=0.005)
    frames = np.array(recording.frames(PROBE_PLANE.states[::10], ARRAY, IMAGING))
    (target,) = recording.frames([Pose(0, 50, 0)], ARRAY, IMAGING)
    # Muscle at the skin, the vertebra's shadow below its arch, and the end of the recording.
    assert target[:5, 10:30].mean() > 150 > 20 > target[25:40, 15:25].mean()
    assert not frames[:, 48:].any()
