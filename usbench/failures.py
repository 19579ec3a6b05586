"""In what ways evaluation episodes go wrong, from records alone: the paper's two failure modes and others."""

import numpy as np
import pandas as pd

# Where the object lies in the paper's phantom.
_TARGET_MM = 50


def shares(evaluations: pd.DataFrame) -> pd.DataFrame:
    """Return how the episodes of each agent end after training, with greedy actions, as shares of all.

    Args:
        evaluations: As `records.load` returns them.

    Returns:
        A row per (task, noise, algo), with the columns `seeds`, `success`, `beside` (the final position is
        not over the object) and, for `fp`, `too_deep` and `too_shallow` (the final focus), for `pp`,
        `out_of_plane` (the final angle is neither 0 nor 180 degrees) and `long_way` (in plane, but turned
        there by more than a right angle). An episode may count in several, or be NaN where a task has none.
    """
    last = evaluations["checkpoint"] == evaluations.groupby("trial")["checkpoint"].transform("max")
    rows = evaluations[last & evaluations["deterministic"]].copy()
    is_fp = rows["task"] == "fp"
    in_plane = np.isclose(rows["final_sin_angle"], 0.0)
    turned = (rows["final_angle_deg"] - rows["start_angle_deg"] + 180) % 360 - 180
    depth = rows["final_focal_depth_mm"]
    kinds = {
        "success": rows["is_success"],
        "beside": rows["final_x_mm"] != 0,
        "too_deep": (depth > _TARGET_MM).where(is_fp),
        "too_shallow": (depth < _TARGET_MM).where(is_fp),
        "out_of_plane": pd.Series(~in_plane, rows.index).where(~is_fp),
        "long_way": (in_plane & (turned.abs() > 90)).where(~is_fp),
    }
    rows = rows.assign(**{name: kind.astype(float) for name, kind in kinds.items()})
    groups = rows.groupby(["task", "noise", "algo"])
    result = groups[list(kinds)].mean()
    result.insert(0, "seeds", groups["seed"].nunique())
    return result.reset_index()
