"""The table of coordinates: poses, moves, limits, records and words follow from its rows."""

from dataclasses import fields

import pytest

from usbench.coordinates import BY_NAME, COORDINATES, POSE, SETTINGS, TARGET
from usbench.envs.pose import Limits, Move, Pose
from usbench.envs.settings import Setup


def names(cls):
    return tuple(field.name for field in fields(cls))


def test_poses_moves_and_limits_have_its_rows_in_its_order():
    assert names(Pose) == POSE and names(Setup) == (*POSE, *SETTINGS) == names(Move) == tuple(BY_NAME)
    bounded = [one for one in COORDINATES if one.limits is not None]
    assert {one.name: one.limits for one in bounded} == vars(Limits())
    assert all(one.period for one in COORDINATES if one.limits is None)


def test_records_have_a_column_for_every_row():
    from usbench.records.episode import COLUMNS

    assert {f"{when}_{name}" for when in ("start", "final") for name in BY_NAME} | {*TARGET} <= set(COLUMNS)


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("x_mm", -10, "10 mm to the left"),
        ("x_mm", 5, "5 mm to the right"),
        ("focal_depth_mm", -5, "5 mm shallower"),
        ("angle_deg", 15, "15° clockwise"),
        ("angle_deg", -15, "15° counter-clockwise"),
        ("frequency_khz", 1_500, "1.5 MHz up"),
        ("dynamic_range_db", -10, "10 dB narrower"),
    ],
)
def test_changes_in_words(name, change, words):
    assert BY_NAME[name].change_in_words(change) == words
