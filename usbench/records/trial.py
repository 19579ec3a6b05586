"""Trials read back as tables."""

from pathlib import Path
from typing import Literal

import numpy as np
import pandas as pd

from usbench.records import checksums
from usbench.records.folder import EPISODES, EVALUATIONS, read_state, trial_folders
from usbench.records.journal import read_rows


def load(
    runs: str | Path = "runs", table: Literal["evaluations", "episodes"] = "evaluations"
) -> pd.DataFrame:
    """Read the episodes of every trial in `runs` into one table, one row per episode.

    Columns of the trial (`trial`, `task`, `noise`, `algo`, `seed`, `status`) come first, then the record's
    own keys, then `normalized_score`: (return - random) / (optimal - random).

    Raises:
        ValueError: If `table` is unknown or a record is broken.
        FileNotFoundError: If `runs` does not exist.
    """
    files = {"evaluations": EVALUATIONS, "episodes": EPISODES}
    if table not in files:
        raise ValueError(f"table must be one of {', '.join(files)}, not {table!r}.")
    if not Path(runs).is_dir():
        raise FileNotFoundError(f"there is no folder {str(runs)!r} with trials.")
    parts = []
    for folder in trial_folders(Path(runs)):
        state = read_state(folder)
        checksums.check(folder, state.get("checksums", {}))
        rows = pd.DataFrame(read_rows(folder / files[table]))
        if rows.empty or "config" not in state:
            continue
        trial = {key: state["config"][key] for key in ("task", "noise", "algo", "seed")}
        for column, value in reversed({"trial": folder.name, **trial, "status": state["status"]}.items()):
            rows.insert(0, column, value)
        anchors = state["anchors"]
        rows["normalized_score"] = (rows["return"] - anchors["random"]) / (
            anchors["optimal"] - anchors["random"]
        )
        parts.append(rows)
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame()


def means(evaluations: pd.DataFrame) -> dict[str, float]:
    """Return the means over evaluation episodes: return, distance, angle between the planes, success.

    The object looks the same from both sides, so the angle is counted modulo 180 degrees.
    """
    error_deg = np.degrees(np.arcsin(np.abs(evaluations["final_sin_angle"])))
    return {
        "return": float(evaluations["return"].mean()),
        "final_distance_mm": float(evaluations["final_distance_mm"].mean()),
        "plane_error_deg": float(error_deg.mean()),
        "success_rate": float(evaluations["is_success"].mean()),
    }
