"""How episodes end, told from records worked out by hand."""

import math

import pandas as pd
import pytest

from usbench.figures import episode_ends


def episode(task, x_mm, depth_mm, start_deg, angle_deg, **others):
    at_object = x_mm == 0 and (depth_mm == 50 if task == "fp" else angle_deg % 180 == 0)
    return {
        "trial": f"{task}-trial",
        "task": task,
        "noise": 0.0,
        "algo": "vpg",
        "seed": 0,
        "checkpoint": 64,
        "deterministic": True,
        "start_angle_deg": start_deg,
        "final_x_mm": x_mm,
        "final_focal_depth_mm": depth_mm,
        "final_angle_deg": angle_deg,
        "final_sin_angle": math.sin(math.radians(angle_deg)),
        "is_success": at_object,
    } | others


def test_focal_point_episodes_end_at_beside_above_or_below_the_object():
    rows = [episode("fp", x, z, 0, 0) for x, z in ((0, 50), (0, 55), (5, 90), (-20, 10))]
    (row,) = episode_ends.shares(pd.DataFrame(rows)).to_dict("records")
    assert row["success"] == 0.25
    assert row["beside"] == 0.5
    assert row["too_deep"] == 0.5
    assert row["too_shallow"] == 0.25
    assert math.isnan(row["out_of_plane"]) and math.isnan(row["long_way"])


@pytest.mark.parametrize(
    ("start_deg", "angle_deg", "long_way"),
    # A right angle is as far one way as the other.
    [
        (45, 0, False),
        (75, 180, True),
        (90, 180, False),
        (90, 0, False),
        (60, 165, False),
        (45, 345, False),
        (45, 30, False),
    ],
)
def test_the_long_way_ends_in_plane_after_more_than_a_right_angle(start_deg, angle_deg, long_way):
    (row,) = episode_ends.shares(pd.DataFrame([episode("pp", 0, 50, start_deg, angle_deg)])).to_dict(
        "records"
    )
    assert row["long_way"] == float(long_way)
    assert row["out_of_plane"] == float(angle_deg % 180 != 0)
    assert row["half_turn"] == float(angle_deg == 180)
    assert row["one_turn_off"] == float(angle_deg in (165, 345))
    assert math.isnan(row["too_deep"])


def test_only_greedy_episodes_after_the_last_step_count_and_seeds_are_counted():
    rows = [
        episode("pp", 0, 50, 45, 0),
        episode("pp", 5, 50, 45, 0, deterministic=False),
        episode("pp", 5, 50, 45, 0, checkpoint=32),
        episode("pp", 0, 50, 45, 15, trial="other", seed=1),
    ]
    (row,) = episode_ends.shares(pd.DataFrame(rows)).to_dict("records")
    assert (row["seeds"], row["success"], row["beside"], row["out_of_plane"]) == (2, 0.5, 0.0, 0.5)


def test_figure_has_a_panel_for_each_cell_and_bars_as_high_as_the_shares():
    ends = episode_ends.shares(
        pd.DataFrame(
            [
                episode("fp", 0, 50, 0, 0),
                episode("fp", 0, 55, 0, 0),
                episode("fp", 5, 90, 0, 0, noise=0.5),
                episode("pp", 0, 50, 45, 0),
            ]
        )
    )
    figure = episode_ends.draw(ends)
    panels = {axis.get_title(): axis for axis in figure.axes}
    assert {"fp, noise 0", "fp, noise 0.5", "pp, noise 0"} <= set(panels)
    heights = [bar.get_height() for bar in panels["fp, noise 0"].patches]
    assert heights == [0.5, 0.0, 0.5, 0.0]  # success, beside, too deep, too shallow
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()][-2:] == ["out of plane", "long way"]


def test_a_later_table_replaces_an_agent_of_a_cell_and_keeps_the_others():
    kept = episode_ends.shares(
        pd.DataFrame([episode("pp", 5, 50, 45, 0), episode("pp", 5, 50, 45, 0, algo="dqn", trial="dqn")])
    )
    new = episode_ends.shares(
        pd.DataFrame([episode("pp", 0, 50, 45, 0), episode("fp", 0, 55, 0, 0, noise=0.5, trial="fp")])
    )
    table = episode_ends.merged(kept, new)
    assert table[["task", "noise", "algo", "success"]].to_numpy().tolist() == [
        ["fp", 0.5, "vpg", 0.0],
        ["pp", 0.0, "dqn", 0.0],
        ["pp", 0.0, "vpg", 1.0],
    ]
