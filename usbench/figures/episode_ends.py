"""The ways in which evaluation episodes fail, from records alone: the two of the paper and others."""

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from usbench import suite
from usbench.envs.oracle import PAPER_TARGET
from usbench.envs.pose import sin_deg
from usbench.figures import style
from usbench.figures.cells import cell_panels
from usbench.results.scores import CELL, Cell

KINDS = (
    "success", "beside", "too_deep", "too_shallow", "out_of_plane", "one_turn_off", "half_turn", "long_way",
)  # fmt: skip
# The kinds that are drawn; hatches tell them apart in a grey print.
_LOOKS = {
    "success": {"color": "#ffffff"},
    "beside": {"color": "#56b4e9"},
    "too_deep": {"color": "#d55e00", "hatch": "////"},
    "too_shallow": {"color": "#0072b2"},
    "out_of_plane": {"color": "#cc79a7", "hatch": "...."},
    "long_way": {"color": "#000000"},
}
_TURN_DEG = 15  # of one action
# Agents whose names fit beside each other below a panel.
_UPRIGHT = 4


def shares(evaluations: pd.DataFrame) -> pd.DataFrame:
    """Return how the episodes of each agent end after training, with greedy actions, as shares of all.

    Args:
        evaluations: As `records.load` returns them.

    Returns:
        A row per (task, noise, algo), with the columns `seeds`, `success`, `beside` (the final position is
        not over the object) and, for tasks that move the focus, `too_deep` and `too_shallow` (the final
        focus), for those that turn the probe, `out_of_plane` (the final angle is not the object's, nor half a
        turn from it), `one_turn_off` (and one action would have put it in plane), `half_turn` (in plane, half
        a turn from the object's angle) and `long_way` (in plane, but turned there by more than a right
        angle). An episode may count in several, or be NaN where a task has none.
    """
    last = evaluations["checkpoint"] == evaluations.groupby("trial")["checkpoint"].transform("max")
    rows = evaluations[last & evaluations["deterministic"]].copy()
    focuses, turns = (rows["task"].map(_moves(name)) for name in ("focal_depth_mm", "angle_deg"))
    x_mm, depth_mm, angle_deg = (_target(rows, name) for name in ("x_mm", "focal_depth_mm", "angle_deg"))
    in_plane = np.isclose(rows["final_sin_angle"], 0.0)
    one_off = np.isclose(rows["final_sin_angle"].abs(), sin_deg(_TURN_DEG))
    turned = (rows["final_angle_deg"] - rows["start_angle_deg"] + 180) % 360 - 180
    beside_deg = (rows["final_angle_deg"] - angle_deg + 180) % 360 - 180
    depth = rows["final_focal_depth_mm"]
    kinds = {
        "success": rows["is_success"],
        "beside": rows["final_x_mm"] != x_mm,
        "too_deep": (depth > depth_mm).where(focuses),
        "too_shallow": (depth < depth_mm).where(focuses),
        "out_of_plane": pd.Series(~in_plane, rows.index).where(turns),
        "one_turn_off": pd.Series(one_off, rows.index).where(turns),
        "half_turn": (in_plane & (beside_deg.abs() > 90)).where(turns),
        "long_way": (in_plane & (turned.abs() > 90)).where(turns),
    }
    rows = rows.assign(**{name: kinds[name].astype(float) for name in KINDS})
    groups = rows.groupby(["task", "noise", "algo"])
    result = groups[list(KINDS)].mean()
    result.insert(0, "seeds", groups["seed"].nunique())
    return result.reset_index()


def merged(kept: pd.DataFrame, new: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of two tables of `shares`; where both have an agent in a cell, that of `new` stays."""
    rows = pd.concat([kept, new]).drop_duplicates([*CELL, "algo"], keep="last")
    return rows.sort_values([*CELL, "algo"], ignore_index=True)


def draw(ends: pd.DataFrame) -> Figure:
    """Draw what `shares` returns: a panel for each task and noise, a group of bars for each agent there."""
    cells = {Cell(*cell): own.set_index("algo") for cell, own in ends.groupby(CELL)}
    figure, panels = cell_panels(dict.fromkeys(cells, 1.7), "", sharey=True)
    handles = {}
    for cell, axis in panels.items():
        own = cells[cell].sort_values("success", ascending=False, kind="stable")
        kinds = [kind for kind in _LOOKS if own[kind].notna().any()]
        width = 0.85 / len(kinds)
        for number, kind in enumerate(kinds):
            at = np.arange(len(own)) + (number - (len(kinds) - 1) / 2) * width
            look = {"edgecolor": "black", "linewidth": 0.4} | _LOOKS[kind]
            handles[kind] = axis.bar(at, own[kind], width, **look)
        names = [name.replace("_", "\n", 1) for name in own.index]
        axis.set_xticks(range(len(own)), names, rotation=90 if len(own) > _UPRIGHT else 0)
    figure.supylabel("share of episodes", fontsize=style.TEXT)
    names = [kind for kind in _LOOKS if kind in handles]
    style.legend(figure, [handles[kind] for kind in names], [kind.replace("_", " ") for kind in names])
    return figure


def _moves(coordinate: str) -> dict[str, bool]:
    """Return which tasks have an action that changes `coordinate`, with the object's as the goal."""
    return {
        name: any(getattr(action.move, coordinate) for action in row.guidance.actions)
        and not row.guidance.reward_from_frames
        for name, row in suite.TASKS.items()
    }


def _target(rows: pd.DataFrame, coordinate: str) -> pd.Series:
    """Return where the object is in each episode: as recorded, or as in the paper's phantom."""
    recorded = rows.get(f"target_{coordinate}", pd.Series(np.nan, rows.index))
    return recorded.astype(float).fillna(getattr(PAPER_TARGET, coordinate))
