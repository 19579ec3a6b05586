"""A setting of values of the wrong types: refused in one short sentence, whichever way it is made."""

import re

import numpy as np
import pytest
import SimpleITK as sitk

from usbench.envs.anatomy import Recording
from usbench.envs.bmode import Imaging
from usbench.envs.frames import frame_store
from usbench.envs.phantom import Phantom
from usbench.envs.pose import Pose
from usbench.envs.probe import DEFAULT_ARRAY
from usbench.records import ConfigurationError
from usbench.setting import Setting, make_env, make_vec_env


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"task": ["pp"]}, r"unknown task \['pp'\] \(did you mean 'pp'\?\): allowed are .*"),
        ({"imaging": {"height_px": 80}}, r"imaging must be of type Imaging, not {'height_px': 80}\."),
        ({"probe": "l7-4"}, r"probe must be of type LinearArray, not 'l7-4'\."),
        ({"probe": Imaging()}, r"probe must be of type LinearArray, not Imaging.*"),
        ({"senses": 5}, r"senses must be a sequence of names, not 5\."),
        ({"senses": "heading"}, r"senses must be a sequence of names, as \('heading',\), not one string\."),
        ({"anatomy": "spine.nii"}, r"anatomy must be of type Anatomy, not 'spine.nii'\."),
        (
            {"anatomy": "spine.nii", "task": "pp-random"},
            r"anatomy must be of type Anatomy, not 'spine.nii'\.",
        ),
        ({"anatomy": Phantom(seed=3)}, r"anatomy must be of type Anatomy, not Phantom.*"),
    ],
)
@pytest.mark.parametrize("make", [Setting, make_env, lambda **values: make_vec_env(num_envs=1, **values)])
def test_a_value_of_another_type_is_refused_in_one_short_sentence(make, values, said):
    with pytest.raises(ConfigurationError) as refused:
        make(**{"task": "pp", **values})
    assert re.fullmatch(said, str(refused.value)) and len(str(refused.value)) < 200


@pytest.mark.parametrize("make", [make_env, lambda task, **given: make_vec_env(task, 1, **given)])
def test_an_unknown_argument_is_refused_with_those_that_there_are(make):
    with pytest.raises(
        ConfigurationError, match=r"unknown argument 'nois' \(did you mean 'noise'\?\).*'noise'"
    ):
        make("pp", nois=0.5)


def test_senses_that_can_be_read_once_are_read_once(tmp_path):
    path = tmp_path / "image.mha"
    sitk.WriteImage(sitk.GetImageFromArray(np.full((90, 80, 80), 100, np.uint8)), str(path))
    anatomy = Recording.read(path, target=Pose(0, 50, 0))
    found = Setting(task="pp", anatomy=anatomy, senses=iter(("heading", "actions")))
    assert found.senses == ("heading", "actions")


def test_no_probe_becomes_the_default_one():
    setting = Setting(task="pp", probe=None)
    assert setting == Setting(task="pp") and setting.probe == DEFAULT_ARRAY
    assert setting.record() == Setting(task="pp").record()


def test_progress_of_frames_goes_on_from_those_that_are_kept():
    small = Imaging(height_px=10, width_px=10)
    setting, told = Setting(task="pp", imaging=small), []
    poses, (phantom,) = setting.guidance.states, setting.evaluation_phantoms()
    frame_store(phantom, setting.probe, small).prepare(poses[:-3])
    setting.prepare_frames(lambda *numbers: told.append(numbers))
    assert told == [(len(poses) - 3 + n, len(poses)) for n in (1, 2, 3)]


def test_anchors_of_no_episodes_are_refused():
    with pytest.raises(ValueError, match="episodes must be one at least, not none"):
        Setting(task="pp-random").anchors(episodes=[])
