"""A custom anatomy in words: what --phantom takes and refuses, and what records say of it."""

import json
import sys

import numpy as np
import pytest
from PIL import Image
from volumes import block

from usbench import cli
from usbench.cli.phantom import custom_anatomy
from usbench.envs.anatomy import Echogenicity, Placement, Recording
from usbench.envs.anatomy.volume_file import read
from usbench.envs.pose import Pose
from usbench.records import ConfigurationError
from usbench.setting import Setting
from usbench.setting_parts import anatomy_record

TARGET = ["target_x_mm=10", "target_angle_deg=30"]
RUN = ["run", "--algo", "vpg", "--task", "pp", "--steps", "64", "--quiet", "--phantom"]


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """81 x 61 x 91 voxels of 1 mm."""
    return block(tmp_path_factory.mktemp("volumes") / "block.mha")


def asked(file, *settings):
    return custom_anatomy([str(file), *TARGET, *settings])


def refusal(capsys, *argv):
    assert cli.main(list(argv)) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith("usbench: error: ") and captured.err.count("\n") == 1
    return captured.err


def test_words_become_an_anatomy(file):
    found = asked(
        file, "frames=recorded", "down=-y", "lateral=k", "center_x_mm=1.5", "center_y_mm=-2", "skin_mm=0"
    )
    assert found == Recording(
        path=str(file),
        digest=read(file).digest,
        target=Pose(10, 50, 30),
        placement=Placement("k", "-y", 1.5, -2.0, 0.0),
    )
    simulated = asked(
        file, "seed=3", "density_per_mm3=0.5", "dynamic_range_db=60", "target_focal_depth_mm=40"
    )
    assert isinstance(simulated, Echogenicity) and simulated.target == Pose(10, 40, 30)
    assert (simulated.seed, simulated.density_per_mm3, simulated.dynamic_range_db) == (3, 0.5, 60.0)
    assert custom_anatomy([]) is None


@pytest.mark.parametrize("frames", ["simulated", "recorded"])
def test_what_is_recorded_is_the_same_again(file, frames):
    found = asked(file, f"frames={frames}", "skin_mm=3")
    plain = json.loads(json.dumps(anatomy_record.plain(found)))
    again = anatomy_record.recorded(plain)
    assert again == found and again.path == found.path and type(again) is type(found)
    assert anatomy_record.recorded({"id": "usbench/ProbePlane-v0", "phantom": {"seed": 0}}) is None


def test_a_class_of_ones_own_cannot_be_recorded(file):
    class Mine(Echogenicity):
        pass

    setting = Setting(task="pp", anatomy=Mine(**vars(asked(file))))
    allowed = "allowed are Echogenicity and Recording"
    with pytest.raises(ConfigurationError, match=f"the class Mine cannot be recorded: {allowed}"):
        setting.record()


@pytest.mark.parametrize(
    "damage",
    [
        {"phantom": None},
        {"phantom": {}},
        {"phantom": {"frames": "dreamt"}},
        {"phantom": {"target": {"x_mm": "far"}}},
        {"phantom": {"placement": {"down": "up"}}},
        {"phantom": {"target": 3}},
        {"phantom": {"seed": 1}},
    ],
)
def test_records_of_strangers_are_refused(file, damage):
    plain = anatomy_record.plain(asked(file, "frames=recorded"))
    phantom = damage["phantom"] and {**plain["phantom"], **damage["phantom"]}
    if damage["phantom"] == {}:
        phantom = {}
    with pytest.raises(ConfigurationError, match="the trial's phantom"):
        anatomy_record.recorded({**plain, "phantom": phantom})


def test_a_missing_file_is_refused_before_its_settings(capsys):
    assert "there is no volume 'nothing.nii'" in refusal(capsys, *RUN, "nothing.nii")


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ([], "target_x_mm"),
        (["frames=filmed", *TARGET], "'recorded'"),
        (["down=up", *TARGET], "'up'"),
        (["dwon=y", *TARGET], "did you mean 'down'"),
        (
            ["frames=recorded", "seed=1", *TARGET],
            "seed is for frames=simulated alone, not for frames=recorded",
        ),
        (["frames=recorded", "density_per_mm3=2", *TARGET], "density_per_mm3 is for frames=simulated alone"),
        (["skin_mm", *TARGET], "name=value"),
        (["skin_mm=deep", *TARGET], "'deep'"),
        (
            ["target_x_mm=7", "target_angle_deg=0"],
            "the nearest, Pose(x_mm=5, focal_depth_mm=50, angle_deg=0)",
        ),
        (
            ["target_x_mm=0", "target_angle_deg=10"],
            "the nearest, Pose(x_mm=0, focal_depth_mm=50, angle_deg=15)",
        ),
        (["target_x_mm=60"], "[-40, 40]"),
        (["target_x_mm=far"], "target_x_mm must be a whole number, not 'far'"),
        (["target_focal_depth_mm=0"], "target_focal_depth_mm must be at least 1, not 0"),
        (["center_x_mm=500", *TARGET], "center_x_mm must be in [-80, 80], where the probe meets the image"),
        (["frames=recorded", "target_focal_depth_mm=500"], "focal_depth_mm must be in [1, 90]"),
        (["target_x_mm=5", *TARGET], "takes target_x_mm once, not 2 times"),
    ],
)
def test_settings_that_cannot_be_are_refused_in_one_sentence(capsys, file, settings, said):
    assert said in refusal(capsys, *RUN, str(file), *settings)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (["--task", "fp"], "keeps the focus of its recording"),
        (["--task", "exam"], "keeps the focus of its recording"),
        (["--task", "setup"], "takes no custom anatomy"),
        (["--task", "pp-random"], "'pp-random' draws its phantoms and takes no custom anatomy"),
        (["--task", "fp-random"], "allowed are 'pp'."),
        (["--reward", "image"], "the reward cannot be 'image'"),
        (["--reward", "image"], "take 'normalized'"),
    ],
)
def test_tasks_that_it_does_not_fit_are_refused(capsys, file, changes, said):
    assert said in refusal(capsys, *RUN, str(file), "frames=recorded", *TARGET, *changes)


def test_tasks_that_take_tissue_are_named(capsys, file):
    said = refusal(capsys, *RUN, str(file), *TARGET, "--task", "pp-random")
    assert "allowed are 'fp', 'pp', 'exam', 'exam-stop'." in said and "kwargs" not in said


def test_a_file_that_is_not_there_is_refused(capsys, tmp_path):
    assert "there is no volume" in refusal(capsys, *RUN, str(tmp_path / "none.mha"), *TARGET)
    other = tmp_path / "none.txt"
    other.write_text("")
    assert ".nii.gz" in refusal(capsys, *RUN, str(other), *TARGET)


def test_without_simple_itk_the_extra_is_named(capsys, file, monkeypatch):
    monkeypatch.setitem(sys.modules, "SimpleITK", None)
    assert "pip install 'usbench[anatomy]'" in refusal(capsys, *RUN, str(file), *TARGET)


def test_a_frame_to_look_around_needs_no_target(capsys, file, tmp_path, monkeypatch):
    out = tmp_path / "slice.png"
    look = ["frame", "--x", "5", "--angle", "30", "--phantom", str(file), "frames=recorded"]
    assert cli.main([*look, "--plain", "--out", str(out)]) == 0
    assert "slice, (90, 40) uint8" in capsys.readouterr().out
    shown = np.asarray(Image.open(out))
    recording = custom_anatomy([str(file), "frames=recorded"], looking=True)
    np.testing.assert_array_equal(shown, recording.recorded_frame(Pose(5, 50, 30), (90, 40), 1e-3))
    monkeypatch.chdir(tmp_path)
    assert cli.main(look) == 0
    # Named after the file and its settings, so that frames of one pose do not overwrite each other.
    assert (tmp_path / f"frame_{file.stem}-frames=recorded_x5_depth50_angle30.png").exists()
    assert "a recorded image has no rf" in refusal(capsys, *look, "--rf")


def test_a_frame_without_the_image_is_refused(capsys, file, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    said = refusal(capsys, "frame", "--phantom", str(file), "frames=recorded", "skin_mm=500")
    assert "skin_mm must be in [-90, 90], where the probe meets the image, not 500" in said
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_rf_of_a_simulated_volume(capsys, file, tmp_path):
    out = tmp_path / "rf.npy"
    assert cli.main(["frame", "--rf", "--out", str(out), "--phantom", str(file), "density_per_mm3=0.01"]) == 0
    rf = np.load(out)
    assert rf.shape[1] == 64 and np.isfinite(rf).all() and rf.any()
