"""Poses with settings of the scanner: their grid, the frames that they give, and how these are kept."""

import re

import numpy as np
import pytest
from stored import SCENE

from usbench.coordinates import BY_NAME
from usbench.envs import scanner
from usbench.envs.bmode import Imaging
from usbench.envs.frames import FrameStore
from usbench.envs.phantom import Phantom
from usbench.envs.pose import Limits, Move, Pose, coordinates
from usbench.envs.probe import LinearArray
from usbench.envs.settings import Setup, as_row, from_row, in_words, table_of, tuned

LIMITS = Limits(frequency_khz=(2_000, 5_000), dynamic_range_db=(20, 90))
SETUP = Setup(5, 60, 30, frequency_khz=3_000, dynamic_range_db=40)


def test_a_move_changes_the_settings_within_their_limits_and_leaves_the_rest():
    assert SETUP.moved(Move(frequency_khz=1_000), LIMITS) == Setup(
        5, 60, 30, frequency_khz=4_000, dynamic_range_db=40
    )
    assert SETUP.moved(Move(dynamic_range_db=-20), LIMITS) == Setup(
        5, 60, 30, frequency_khz=3_000, dynamic_range_db=20
    )
    assert SETUP.moved(Move(x_mm=-5, angle_deg=-45), LIMITS) == Setup(
        0, 60, 345, frequency_khz=3_000, dynamic_range_db=40
    )
    for blocked in (Move(frequency_khz=3_000), Move(frequency_khz=-2_000), Move(dynamic_range_db=60)):
        assert SETUP.moved(blocked, LIMITS) == SETUP
    assert Pose(5, 60, 30).moved(Move(frequency_khz=1_000), LIMITS) == Pose(5, 60, 30) != SETUP


@pytest.mark.parametrize(
    ("values", "error", "said"),
    [
        ({"frequency_khz": 0}, ValueError, "frequency_khz must be at least 1, not 0."),
        ({"dynamic_range_db": -10}, ValueError, "dynamic_range_db must be at least 1, not -10."),
        ({"frequency_khz": 3.5}, ValueError, "frequency_khz must be a whole number, not 3.5."),
        ({"dynamic_range_db": "60"}, TypeError, "dynamic_range_db must be a whole number, not '60'."),
        ({"focal_depth_mm": 0}, ValueError, "focal_depth_mm must be at least 1, not 0."),
    ],
)
def test_what_is_no_setting_is_refused(values, error, said):
    with pytest.raises(error) as refused:
        Setup(**values)
    assert str(refused.value) == said


@pytest.mark.parametrize("name", ["frequency_khz", "dynamic_range_db"])
def test_limits_are_checked(name):
    with pytest.raises(ValueError, match=f"the limits of {name} must be .low, high., not .5, 4."):
        Limits(**{name: (5, 4)})
    with pytest.raises(ValueError, match=f"{name} must be in .2, 4., not 5"):
        Limits(**{name: (2, 4)}).check(Setup(**{name: 5}))
    LIMITS.check(SETUP)


def test_limits_may_be_a_list_or_an_array():
    assert Limits(x_mm=[-5, 5]) == Limits(x_mm=np.array([-5, 5])) == Limits(x_mm=(-5, 5))


@pytest.mark.parametrize("given", [5, None, "05", (1,), (1, 2, 3)])
def test_limits_that_are_no_pair_are_refused(given):
    with pytest.raises(
        ValueError, match=f"the limits of x_mm must be .low, high., not {re.escape(repr(given))}"
    ):
        Limits(x_mm=given)


def test_settings_stand_in_place_of_the_arrays_and_the_imagings():
    array, imaging = LinearArray(n_active=32), Imaging(median_size=3)
    pose, tuned_array, tuned_imaging = tuned(SETUP, array, imaging)
    assert (type(pose), pose) == (Pose, Pose(5, 60, 30))
    assert tuned_array == LinearArray(n_active=32, center_frequency=3e6)
    assert tuned_imaging == Imaging(median_size=3, dynamic_range_db=40)
    assert tuned(Pose(5, 60, 30), array, imaging) == (Pose(5, 60, 30), array, imaging)


def test_rows_words_and_names():
    for pose in (SETUP, Pose(-5, 50, 15)):
        assert from_row(as_row(pose)) == pose and type(from_row(as_row(pose))) is type(pose)
    numbers = dict(zip(BY_NAME, as_row(Pose(-5, 50, 15)), strict=True))
    assert numbers == dict.fromkeys(BY_NAME, 0) | {"x_mm": -5, "focal_depth_mm": 50, "angle_deg": 15}
    assert in_words(Setup(frequency_khz=3_500)) == ["3.5 MHz", "60 dB"] and in_words(Pose()) == []
    assert coordinates(SETUP) == (*coordinates(Pose()), "frequency_khz", "dynamic_range_db")
    assert table_of(SETUP) == (60, 3_000) != table_of(Pose(5, 60, 30))


def test_frames_follow_their_settings(monkeypatch):
    simulated = []

    def simulate(positions, amplitudes, array, focal_depth, **kwargs):
        simulated.append((array.center_frequency, focal_depth, kwargs["attenuation_db_per_cm_mhz"]))
        noise = np.random.default_rng(0).normal(size=(2, 700, 64))
        return (noise[0] + 1j * noise[1]) * np.exp(-np.arange(700) / 200)[:, np.newaxis], np.arange(700)

    monkeypatch.setattr(scanner, "simulate_iq", simulate)
    phantom = Phantom(attenuation_db_per_cm_mhz=0.5)
    narrow, wide = (
        scanner.scan(phantom, Setup(0, 60, 0, frequency_khz=4_000, dynamic_range_db=db)) for db in (20, 60)
    )
    assert simulated == [(4e6, 60e-3, 0.5)] * 2
    assert (narrow == 0).sum() > (wide == 0).sum()  # weak echoes are black
    scanner.scan(phantom, Setup(0, 60, 0, frequency_khz=3_000, dynamic_range_db=60))
    scanner.scan(phantom, Pose(0, 60, 0))
    assert [frequency for frequency, *_ in simulated] == [4e6, 4e6, 3e6, 3.5e6]


def test_frames_of_settings_are_kept_beside_those_of_plain_poses(scans, monkeypatch):
    def scan(phantom, pose, array, imaging):
        return np.full((90, 40), getattr(pose, "dynamic_range_db", 0), np.uint8)

    for module in ("frames", "scanner"):
        monkeypatch.setattr(f"usbench.envs.{module}.scan", scan)
    poses = [
        Setup(0, 50, 0, frequency_khz=khz, dynamic_range_db=db) for khz in (2_000, 3_000) for db in (20, 40)
    ] + [Pose(0, 50, 0)]
    FrameStore(*SCENE).prepare(poses)
    monkeypatch.setattr("usbench.envs.frames.scan", lambda *_: pytest.fail("simulated again"))
    other = FrameStore(*SCENE)
    assert [other.frame(pose)[0, 0] for pose in poses] == [20, 40, 20, 40, 0]
