"""What a picture is taken of: poses, settings and phantoms that can be, and refusals of others."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

from usbench.envs.anatomy import Recording
from usbench.envs.anatomy.points import PointScatterers
from usbench.envs.bmode import Imaging
from usbench.envs.phantom import Phantom
from usbench.envs.pose import Pose
from usbench.envs.probe import LinearArray
from usbench.envs.settings import Setup
from usbench.envs.tasks.imaging_setup import PHANTOM
from usbench.envs.tasks.random_phantoms import FocalPointRandomEnv
from usbench.records import ConfigurationError
from usbench.watch import snapshot_option
from usbench.watch.snapshot_option import Source, imaging_of


def pose(source, *values, **settings):
    return snapshot_option.placed(source, *values, **settings)[1]


def test_a_pose_without_settings_is_plain_and_a_frequency_brings_the_dynamic_range():
    assert snapshot_option.placed(Source(), 1, 37, -30) == (Source(), Pose(1, 37, 330))
    assert pose(Source(), 0, 50, 0, frequency_mhz=2.5) == Setup(
        0, 50, 0, frequency_khz=2_500, dynamic_range_db=60
    )
    source = Source(probe=LinearArray(center_frequency=5e6), imaging=Imaging(dynamic_range_db=50))
    assert snapshot_option.placed(source, 0, 50, 0, frequency_mhz=4) == (
        source,
        Setup(0, 50, 0, frequency_khz=4_000, dynamic_range_db=50),
    )


def test_a_dynamic_range_alone_is_that_of_the_imaging():
    source = Source(probe=LinearArray(center_frequency=5.2083e6), imaging=Imaging(median_size=3))
    imaging = Imaging(median_size=3, dynamic_range_db=40)
    assert snapshot_option.placed(source, 0, 50, 0, dynamic_range_db=40) == (
        replace(source, imaging=imaging),
        Pose(0, 50, 0),
    )


@pytest.mark.parametrize("settings", [{"frequency_mhz": 3}, {"dynamic_range_db": 40}])
def test_settings_of_a_recorded_image_are_refused(settings):
    recorded = Recording(path="a.nii", digest="0")
    with pytest.raises(ConfigurationError, match="^a recorded image has no settings of a scanner: leave"):
        pose(Source(recorded), 0, 50, 0, **settings)


@pytest.mark.parametrize(
    ("parts", "said"),
    [
        ({"probe": LinearArray(n_lines=96)}, "keeps the probe of its recording"),
        ({"imaging": Imaging(dynamic_range_db=20)}, "leave dynamic_range_db at 60.0, not 20"),
        ({"imaging": Imaging(noise_db=40)}, "leave noise_db at None, not 40"),
        ({"imaging": Imaging(median_size=1)}, "leave median_size at 5, not 1"),
    ],
)
def test_what_no_slice_follows_from_is_refused(parts, said):
    recorded = Recording(path="a.nii", digest="0")
    with pytest.raises(ConfigurationError, match=said):
        pose(Source(recorded, **parts), 0, 50, 0)
    with pytest.raises(ValueError, match=said):
        gym.make("usbench/ProbePlane-v0", phantom=recorded, **parts)


def test_a_frequency_that_the_probe_does_not_sample_is_refused():
    source = Source(probe=LinearArray(sampling_frequency=30e6))
    with pytest.raises(ConfigurationError, match="sampling_frequency must be at least 7 times"):
        pose(source, 0, 50, 0, frequency_mhz=9)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ((0.5, 50, 0), "x_mm must be a whole number, not 0.5"),
        (("left", 50, 0), "'left'"),
        ((-41, 50, 0), r"\[-40, 40\].* not -41"),
        ((0, 0, 0), "at least 1, not 0"),
        ((0, 501, 0), r"\[1, 500\], not 501"),
        ((0, 50, float("nan")), "nan"),
        ((0, 50, 0, 0.9), r"frequency_mhz must be a number in \[1, 10\], not 0.9"),
        ((0, 50, 0, float("nan")), r"frequency_mhz must be a number in \[1, 10\], not nan"),
        ((0, 50, 0, "high"), r"frequency_mhz must be a number in \[1, 10\], not 'high'"),
        ((0, 50, 0, True), r"frequency_mhz must be a number in \[1, 10\], not True"),
        ((0, 50, 0, 3.5001), "frequency_mhz must be in whole kHz, as 3.5 is, not 3.5001"),
        ((0, 50, 0, None, 0), r"dynamic_range_db must be a whole number in \[1, 200\], not 0"),
        ((0, 50, 0, None, 40.5), r"dynamic_range_db must be a whole number in \[1, 200\], not 40.5"),
    ],
)
def test_poses_and_settings_that_see_nothing_are_refused(values, said):
    with pytest.raises(ConfigurationError, match=said):
        pose(Source(), *values)


def test_a_range_of_the_imaging_that_is_not_whole_is_named_where_a_frequency_needs_one():
    source = Source(imaging=Imaging(dynamic_range_db=47.5))
    with pytest.raises(ConfigurationError, match=r"imaging's dynamic_range_db beside a frequency .* 47.5"):
        pose(source, 0, 50, 0, frequency_mhz=3)
    assert pose(source, 0, 50, 0, frequency_mhz=3, dynamic_range_db=48).dynamic_range_db == 48


def test_phantoms_are_those_of_the_tasks():
    assert (
        snapshot_option.phantom_of(None)
        == snapshot_option.phantom_of("pp")
        == snapshot_option.phantom_of("exam")
        == Phantom()
    )
    assert snapshot_option.phantom_of("setup") == PHANTOM
    for number in (7, np.int64(7)):
        assert snapshot_option.phantom_of("fp-random", number) == FocalPointRandomEnv.distribution.phantom(7)
    assert snapshot_option.phantom_of("fp-random") == FocalPointRandomEnv.distribution.phantom(0)


def test_phantoms_have_names_but_for_the_papers():
    named = [
        snapshot_option.label(*asked)
        for asked in ((None,), ("pp",), ("setup",), ("fp-random",), ("fp-random", 7))
    ]
    assert named == ["", "", "setup", "fp-random-0", "fp-random-7"]


@pytest.mark.parametrize(
    ("task", "number", "said"),
    [
        ("pprandom", None, "unknown task 'pprandom' .did you mean 'pp-random'"),
        ("pp", 3, "only fp-random, pp-random, pp-tracked, exam-random, exam-tracked have several phantoms"),
        (None, 3, "only fp-random, pp-random, pp-tracked, exam-random, exam-tracked have several phantoms"),
        ("pp-random", -1, r"phantom must be a whole number in \[0, 4294967295\], not -1"),
        ("pp-random", 2**32, "not 4294967296"),
        ("pp-random", 0.5, r"phantom must be a whole number in \[0, 4294967295\], not 0.5"),
        ("pp-random", "first", "'first'"),
    ],
)
def test_phantoms_that_are_not_there_are_refused(task, number, said):
    with pytest.raises(ConfigurationError, match=said):
        snapshot_option.phantom_of(task, number)


def test_pixels_of_another_size_keep_the_extent():
    imaging = imaging_of(Source(), pixel_mm=0.2, median_size=3)
    assert (imaging.height_px, imaging.width_px, imaging.median_size) == (450, 200, 3)
    assert imaging_of(Source()) == Imaging()


def test_a_frame_of_points_shows_all_of_them():
    points = PointScatterers([(0, 0, 30e-3)], [1.0])
    imaging = imaging_of(Source(points))
    assert (imaging.pixel_size, imaging.median_size) == (0.2e-3, 1)
    assert (imaging.width, imaging.depth) == pytest.approx((40e-3, 34e-3))
    deepest = PointScatterers([(0, 0, 0.5)], [1.0])
    assert imaging_of(Source(deepest)).depth == pytest.approx(0.5)
    for pixel_mm in (0.3, 0.35, 0.9):  # whole pixels end before the largest depth
        assert 0 <= 0.5 - imaging_of(Source(deepest), pixel_mm=pixel_mm).depth < pixel_mm * 1e-3


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"pixel_mm": 0}, r"pixel_mm must be a number in \[0.01, 10\], not 0"),
        ({"pixel_mm": "fine"}, r"pixel_mm must be a number in \[0.01, 10\], not 'fine'"),
        ({"median_size": 2}, "median_size must be odd, not 2"),
    ],
)
def test_refuses_pixels(options, message):
    with pytest.raises(ConfigurationError, match=message):
        imaging_of(Source(), **options)
