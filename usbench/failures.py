"""In what ways evaluation episodes go wrong, from records alone: the paper's two failure modes and others."""

import numpy as np
import pandas as pd

from usbench import suite
from usbench.envs.oracle import PAPER_TARGET


def shares(evaluations: pd.DataFrame) -> pd.DataFrame:
    """Return how the episodes of each agent end after training, with greedy actions, as shares of all.

    Args:
        evaluations: As `records.load` returns them.

    Returns:
        A row per (task, noise, algo), with the columns `seeds`, `success`, `beside` (the final position is
        not over the object) and, for tasks that move the focus, `too_deep` and `too_shallow` (the final
        focus), for those that turn the probe, `out_of_plane` (the final angle is not the object's, nor half a
        turn from it) and `long_way` (in plane, but turned there by more than a right angle). An episode may
        count in several, or be NaN where a task has none.
    """
    last = evaluations["checkpoint"] == evaluations.groupby("trial")["checkpoint"].transform("max")
    rows = evaluations[last & evaluations["deterministic"]].copy()
    focuses, turns = (rows["task"].map(_moves(name)) for name in ("focal_depth_mm", "angle_deg"))
    x_mm, depth_mm = (_target(rows, name) for name in ("x_mm", "focal_depth_mm"))
    in_plane = np.isclose(rows["final_sin_angle"], 0.0)
    turned = (rows["final_angle_deg"] - rows["start_angle_deg"] + 180) % 360 - 180
    depth = rows["final_focal_depth_mm"]
    kinds = {
        "success": rows["is_success"],
        "beside": rows["final_x_mm"] != x_mm,
        "too_deep": (depth > depth_mm).where(focuses),
        "too_shallow": (depth < depth_mm).where(focuses),
        "out_of_plane": pd.Series(~in_plane, rows.index).where(turns),
        "long_way": (in_plane & (turned.abs() > 90)).where(turns),
    }
    rows = rows.assign(**{name: kind.astype(float) for name, kind in kinds.items()})
    groups = rows.groupby(["task", "noise", "algo"])
    result = groups[list(kinds)].mean()
    result.insert(0, "seeds", groups["seed"].nunique())
    return result.reset_index()


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
