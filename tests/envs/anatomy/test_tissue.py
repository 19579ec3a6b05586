"""A user's own anatomy: files that may move but not change, the target, and the environment."""

import dataclasses
import math
import pickle

import gymnasium as gym
import numpy as np
import pytest
import SimpleITK as sitk
from volumes import write

from usbench.envs.anatomy import Echogenicity, Placement, Recording
from usbench.envs.anatomy import tissue as anatomy
from usbench.envs.anatomy.volume_file import read
from usbench.envs.bmode import Imaging
from usbench.envs.frames import FrameStore
from usbench.envs.phantom import Phantom
from usbench.envs.pose import Pose
from usbench.envs.probe import LinearArray
from usbench.envs.scanner import scan
from usbench.envs.tissue import Tissue

ARRAY, IMAGING = LinearArray(), Imaging()
SHAPE = (90, 40), 1e-3


def test_an_anatomy_is_its_content(tissue_file, tmp_path):
    one = Recording.read(tissue_file, target=Pose(5, 50, 30))
    copy = tmp_path / "copy.nrrd"
    sitk.WriteImage(sitk.ReadImage(str(tissue_file)), str(copy))
    other = Recording.read(copy, target=Pose(5, 50, 30))
    assert one == other and hash(one) == hash(other) and one.path != other.path
    stores = [FrameStore(phantom, ARRAY, IMAGING) for phantom in (one, other)]
    assert stores[0].path == stores[1].path
    settings = [{"placement": Placement(skin_mm=1.0)}, {"digest": "0" * 64}]
    different = [dataclasses.replace(one, **change) for change in settings]
    different += [Echogenicity.read(tissue_file), Echogenicity.read(tissue_file, seed=1)]
    paths = {FrameStore(phantom, ARRAY, IMAGING).path for phantom in (one, *different)}
    assert len(paths) == 1 + len(different)
    # What is looked for changes no frame.
    elsewhere = dataclasses.replace(one, target=Pose(0, 50, 0))
    assert elsewhere != one and FrameStore(elsewhere, ARRAY, IMAGING).path == stores[0].path


def test_a_file_that_changed_is_never_taken_for_what_it_was(tmp_path):
    path = write(tmp_path / "image.mha", np.full((90, 80, 80), 100, np.uint8))
    recording = Recording.read(path)
    before = recording.recorded_frame(Pose(), *SHAPE)
    write(path, np.full((90, 80, 80), 101, np.uint8))
    # This process has read it; another one would have to now.
    np.testing.assert_array_equal(recording.recorded_frame(Pose(), *SHAPE), before)
    anatomy._kept.clear()
    with pytest.raises(
        ValueError, match=r"image.mha' has been changed: its digest must be \w{16}, not \w{16}"
    ):
        recording.recorded_frame(Pose(), *SHAPE)
    assert Recording.read(path) != recording
    path.unlink()
    with pytest.raises(FileNotFoundError, match="there is no volume"):
        dataclasses.replace(recording, digest="1" * 64).recorded_frame(Pose(), *SHAPE)


def test_a_moved_file_is_known_by_its_content(tmp_path):
    path = write(tmp_path / "image.mha", np.full((90, 80, 80), 100, np.uint8))
    recording = Recording.read(path)
    moved = path.rename(tmp_path / "moved.mha")
    Recording.read(moved)
    Recording.read(write(tmp_path / "other.mha", np.full((90, 80, 80), 101, np.uint8)))
    assert recording.recorded_frame(Pose(), *SHAPE).shape == SHAPE[0]


def test_a_file_is_read_once(tissue_file, monkeypatch):
    files = []
    monkeypatch.setattr(anatomy, "read", lambda path: files.append(path) or read(path))
    anatomy._kept.clear()
    recording = Recording.read(tissue_file, target=Pose(5, 50, 30))
    recording.recorded_frame(Pose(), *SHAPE)
    assert dataclasses.replace(recording, target=Pose()).volume is recording.volume
    assert len(files) == 1


@pytest.mark.parametrize("name", ["voxels", "spacing_mm", "origin_mm", "directions"])
def test_the_volume_is_read_only(tissue_file, name):
    """Anatomies of the same content share it, and the digest that names their frames is that of the file."""
    with pytest.raises(ValueError, match="read-only"):
        getattr(Recording.read(tissue_file).volume, name)[:] *= 2


def test_a_pickled_anatomy_is_its_configuration(tissue_file):
    tissue = Echogenicity.read(tissue_file)
    tissue.in_view(Pose(), 0.020, 0.005)
    content = pickle.dumps(tissue)
    assert len(content) < 1000 and pickle.loads(content) == tissue


@pytest.mark.parametrize("x_mm", [-41, 41])
def test_a_target_beside_the_image_is_refused(tissue_file, x_mm):
    with pytest.raises(ValueError, match=rf"target's x_mm must be in \[-40, 40\], .* not {x_mm}"):
        Recording.read(tissue_file, target=Pose(x_mm, 50, 0))


def test_a_target_below_the_image_is_refused_where_there_is_a_focus(tissue_file):
    placement = Placement(skin_mm=30.0)
    Recording.read(tissue_file, target=Pose(0, 61, 0), placement=placement)
    Echogenicity.read(tissue_file, target=Pose(0, 60, 0), placement=placement)
    with pytest.raises(ValueError, match=r"focal_depth_mm must be in \[0, 60\], .* not 61"):
        Echogenicity.read(tissue_file, target=Pose(0, 61, 0), placement=placement)


def test_a_target_below_all_frames_is_refused_where_there_is_no_focus(tissue_file):
    Recording.read(tissue_file, target=Pose(0, 90, 0))
    with pytest.raises(ValueError, match=r"focal_depth_mm must be in \[1, 90\], as deep .* not 91"):
        Recording.read(tissue_file, target=Pose(0, 91, 0))


@pytest.mark.parametrize(
    ("setting", "allowed", "wrong"),
    [
        ("center_x_mm", (-80, 80), (-81.0, 500.0)),
        ("center_y_mm", (-30, 30), (-31.0, 30.5)),
        ("skin_mm", (-90, 90), (-91.0, 500.0)),
    ],
)
@pytest.mark.parametrize("target", [None, Pose()])
def test_an_image_that_the_probe_misses_is_refused(tissue_file, setting, allowed, wrong, target):
    for value in allowed:
        Recording.read(tissue_file, placement=Placement(**{setting: value}))
    for value in wrong:
        said = rf"{setting} must be in \[{allowed[0]}, {allowed[1]}\], .* not {value:g}"
        with pytest.raises(ValueError, match=said):
            Recording.read(tissue_file, placement=Placement(**{setting: value}), target=target)


def test_a_turned_image_that_the_probe_misses_with_all_its_planes_is_refused(image):
    # A cube on its edge, of which only the lower one is below the skin: the box around it is met, it is not.
    turn = np.array([[math.sqrt(0.5), 0, -math.sqrt(0.5)], [0, 1, 0], [math.sqrt(0.5), 0, math.sqrt(0.5)]])
    path = image(lambda x, y, z: 100 + 0 * x, (21, 21, 21), (2.0,) * 3, directions=turn)
    placement = Placement(center_x_mm=60, skin_mm=50)
    with pytest.raises(ValueError, match="no image plane .* see center_x_mm, center_y_mm and skin_mm"):
        Recording.read(path, target=Pose(), placement=placement)


@pytest.mark.parametrize(
    ("settings", "error", "said"),
    [
        ({"seed": -1}, ValueError, "seed .* not -1"),
        ({"seed": 1.5}, ValueError, "seed .* not 1.5"),
        ({"density_per_mm3": 0.0}, ValueError, r"density_per_mm3 must be a number in \(0, 10\], not 0"),
        ({"density_per_mm3": 11}, ValueError, r"density_per_mm3 must be a number in \(0, 10\], not 11"),
        (
            {"density_per_mm3": "many"},
            TypeError,
            r"density_per_mm3 must be a number in \(0, 10\], not 'many'",
        ),
        ({"dynamic_range_db": 0}, ValueError, "dynamic_range_db must be a positive number, not 0"),
        ({"target": (0, 50, 0)}, TypeError, r"target must be of type Pose, not \(0, 50, 0\)"),
        ({"placement": {}}, TypeError, "placement must be of type Placement, not {}"),
        ({"dynamic_range_db": "60 dB"}, TypeError, "dynamic_range_db must be a positive number, not '60 dB'"),
        ({"placement": Placement("x", "-x")}, ValueError, "right angles, not 'x' and '-x'"),
    ],
)
def test_settings_that_cannot_be_are_refused(tissue_file, settings, error, said):
    with pytest.raises(error, match=said):
        Echogenicity.read(tissue_file, **settings)


def test_the_environment_examines_it(tissue_file):
    recording = Recording.read(tissue_file, target=Pose(10, 50, 30))
    env = gym.make("usbench/ProbePlane-v0", phantom=recording, render_mode="rgb_array")
    frame, info = env.reset(seed=1, options={"x_mm": 5, "angle_deg": 45})
    np.testing.assert_array_equal(frame[:, :, 0], recording.recorded_frame(Pose(5, 50, 45), *SHAPE))
    assert [info[f"target_{name}"] for name in ("x_mm", "focal_depth_mm", "angle_deg")] == [10, 50, 30]
    assert info["distance_mm"] == 5 and info["sin_angle"] == pytest.approx(math.sin(math.radians(15)))
    _, reward, *_ = env.step(2)
    assert reward == pytest.approx(-math.sin(math.radians(15)))
    _, reward, _, _, info = env.step(3)
    assert reward == 0 and info["is_success"]
    assert env.render().shape == (580, 1240, 3)


@pytest.mark.parametrize("name", ["FocalPoint", "Examination", "ExaminationStop"])
def test_a_recording_has_no_focus_to_be_moved(tissue_file, name):
    with pytest.raises(ValueError, match="a recorded image keeps the focus of its recording"):
        gym.make(f"usbench/{name}-v0", phantom=Recording.read(tissue_file))
    assert gym.make(f"usbench/{name}-v0", phantom=Echogenicity.read(tissue_file)).unwrapped.target == Pose()


def test_a_recording_cannot_be_simulated(tissue_file):
    with pytest.raises(ValueError, match="a recorded image has no scatterers"):
        scan(Recording.read(tissue_file), Pose())


def test_phantoms_and_anatomies_are_tissue(tissue_file):
    for tissue in (Phantom(), Recording.read(tissue_file), Echogenicity.read(tissue_file)):
        assert isinstance(tissue, Tissue) and tissue.shown.target is not None


def test_a_reward_from_the_image_of_another_object_is_refused(tissue_file):
    with pytest.raises(ValueError, match="the reward cannot be 'image', .* take 'normalized'"):
        gym.make("usbench/ProbePlane-v0", phantom=Recording.read(tissue_file), reward="image")


@pytest.mark.parametrize("phantom", ["block.mha", Recording, 3])
def test_what_is_no_phantom_is_refused(phantom):
    with pytest.raises(TypeError, match="phantom must be of type Phantom"):
        gym.make("usbench/ProbePlane-v0", phantom=phantom)
