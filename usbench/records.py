"""What a trial leaves behind: one folder, written so that a crash loses nothing, and read back as a table.

A trial folder holds `trial.json` (resolved configuration, versions, hash of the frames, status, anchors),
`episodes.jsonl` (one line per training episode), `evaluations.jsonl` (one line per evaluation episode),
`model.zip` and TensorBoard events; while it runs, `checkpoints` too. Nothing here imports torch.
"""

import hashlib
import json
import re
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd

from usbench import checksums, wellformed
from usbench.atomic import atomic_file
from usbench.journal import read_rows

SCHEMA = 1
STATUSES = ("running", "interrupted", "failed", "finished")
TRIAL, EPISODES, EVALUATIONS, MODEL = "trial.json", "episodes.jsonl", "evaluations.jsonl", "model.zip"
TENSORBOARD, CHECKPOINTS = "tensorboard", "checkpoints"
# In `info` and in files where every episode has a phantom of its own.
OF_A_PHANTOM = ("phantom", "target_x_mm", "target_focal_depth_mm", "target_angle_deg")
# In the configuration of an environment: the file of a phantom of one's own. The phantom tells its content.
VOLUME = "volume"
# Of a start or final pose, in `info` and in files of tasks that change the scanner's settings.
SETTINGS = ("frequency_khz", "dynamic_range_db")
_EARLIER = re.compile(r"\.earlier-\d+$")


class ConfigurationError(ValueError):
    """A setting that cannot be used; the message is one sentence for the user."""


@dataclass(frozen=True, kw_only=True)
class TrialConfig:
    """The resolved configuration of one trial; equal configurations give equal bits.

    Attributes:
        task: Name of the task in the suite.
        algo: Name of the algorithm in the zoo.
        noise: Probability p_n of a displacement after a step.
        seed: Trial seed, from which every random stream is spawned.
        steps: Training budget in environment steps, kept exactly (0 for agents that do not learn).
        n_frames: Frames in one observation.
        hyperparameters: Every hyperparameter of the algorithm, after defaults, presets and overrides.
        environment: The environment's own configuration (id, phantom, probe, imaging), as plain values.
    """

    task: str
    algo: str
    noise: float
    seed: int
    steps: int
    n_frames: int = 4
    hyperparameters: Mapping[str, Any] = field(default_factory=dict)
    environment: Mapping[str, Any] = field(default_factory=dict)

    @property
    def hash(self) -> str:
        """Eight hexadecimal digits that change with any part of the configuration but a file's place."""
        canonical = json.dumps(identity(asdict(self)), sort_keys=True, separators=(",", ":"), default=str)
        return hashlib.sha256(canonical.encode()).hexdigest()[:8]

    @property
    def folder_name(self) -> str:
        """`<task>-p<noise>-<algo>-s<seed>-<hash>`."""
        algo = self.algo.replace(":", ".")  # no colon in a name on Windows
        return f"{self.task}-p{self.noise:g}-{algo}-s{self.seed}-{self.hash}"


@dataclass(frozen=True, kw_only=True)
class Episode:
    """One episode, from its start to the pose after its last step.

    Attributes:
        episode: Number of the episode, from 0.
        step: Training steps made at its end (for an evaluation: when it took place).
        return_: Sum of rewards; the key in files is `return`.
        start_x_mm: Start pose, like the two after it.
        final_x_mm: Final pose, like the two after it.
        final_distance_mm: Distance from the object as the task defines it.
        final_sin_angle: Sine of the angle between image plane and object.
        is_success: Whether the final pose is the goal.
        steps_to_goal: Steps until the goal was first reached, None if it never was.
        phantom: Number of the episode's phantom, where each has its own; only then in files.
        target_x_mm: Pose that shows its object best, like the two after it; in files where it is not the
            paper's.
        start_frequency_khz: Settings of the scanner at the start and at the end, like the three after it,
            where the task changes them; only then in files.
    """

    episode: int
    step: int
    return_: float
    start_x_mm: int
    start_focal_depth_mm: int
    start_angle_deg: int
    final_x_mm: int
    final_focal_depth_mm: int
    final_angle_deg: int
    final_distance_mm: float
    final_sin_angle: float
    is_success: bool
    steps_to_goal: int | None
    phantom: int | None = None
    target_x_mm: int | None = None
    target_focal_depth_mm: int | None = None
    target_angle_deg: int | None = None
    start_frequency_khz: int | None = None
    start_dynamic_range_db: int | None = None
    final_frequency_khz: int | None = None
    final_dynamic_range_db: int | None = None

    def as_row(self) -> dict[str, Any]:
        """Return the line of the record file, as a dictionary."""
        row = {key.rstrip("_"): value for key, value in asdict(self).items()}
        return {key: value for key, value in row.items() if key not in _MAY_LACK or value is not None}


_MAY_LACK = (*OF_A_PHANTOM, *(f"{when}_{name}" for when in ("start", "final") for name in SETTINGS))


@dataclass(frozen=True, kw_only=True)
class Evaluation(Episode):
    """One evaluation episode at one checkpoint.

    Attributes:
        checkpoint: Planned training step, the same for every algorithm; `step` is the real one.
        deterministic: Whether the agent took its most likely action rather than a drawn one.
        eval_episode: Number in the suite's fixed list.
        actions: The actions taken, which together with the list are enough to replay the episode.
    """

    checkpoint: int
    deterministic: bool
    eval_episode: int
    actions: Sequence[int]


def identity(config: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return a configuration without the place of the phantom's file, which may be moved."""
    environment = config.get("environment", {})
    if VOLUME not in environment:
        return config
    return {**config, "environment": {key: value for key, value in environment.items() if key != VOLUME}}


def create(out: Path, config: TrialConfig) -> Path:
    """Make an empty trial folder and return its path; an earlier one with episodes is kept beside it.

    Raises:
        ConfigurationError: If the folder cannot be made or written.
    """
    folder = out / config.folder_name
    try:
        out.mkdir(parents=True, exist_ok=True)
        if folder.exists() and not _is_empty(folder):
            number = 1
            while (earlier := folder.with_name(f"{folder.name}.earlier-{number}")).exists():
                number += 1
            folder.rename(earlier)
        folder.mkdir(exist_ok=True)
        with atomic_file(folder / TRIAL) as file:
            file.write(b"{}\n")
    except OSError as error:
        raise unwritable(out, error) from error
    return folder


def unwritable(out: Path, error: OSError) -> ConfigurationError:
    """Return the error for an output folder that cannot be written."""
    return ConfigurationError(
        f"the output folder {str(out)!r} cannot be written ({error.strerror}): choose another with --out."
    )


def _is_empty(folder: Path) -> bool:
    """Return whether a trial ended in `folder` before its first episode; what it left is removed then."""
    sizes = {path.name: path.stat().st_size for path in folder.iterdir()}
    made = {TRIAL, EPISODES, EVALUATIONS, MODEL, TENSORBOARD, CHECKPOINTS}
    if not sizes.keys() <= made or sizes.get(EPISODES):
        return False
    for name in sizes:
        path = folder / name
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    return True


def write_state(folder: Path, state: Mapping[str, Any]) -> None:
    """Write `trial.json`.

    Raises:
        ValueError: If the status is not one of STATUSES.
    """
    if state["status"] not in STATUSES:
        raise ValueError(f"status must be one of {', '.join(STATUSES)}, not {state['status']!r}.")
    content = json.loads(json.dumps({"schema": SCHEMA, **state}, default=str))
    content[checksums.KEY] = checksums.of_state(content)
    with atomic_file(folder / TRIAL) as file:
        file.write(json.dumps(content, indent=2, sort_keys=True).encode() + b"\n")


def read_state(folder: Path) -> dict[str, Any]:
    """Read `trial.json`; an empty dictionary if there is none.

    Raises:
        ValueError: If the file is not the JSON that `write_state` writes, or was changed since.
    """
    path = folder / TRIAL
    try:
        state = json.loads(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, NotADirectoryError):
        return {}
    except ValueError as error:
        raise ValueError(f"{path} is not a trial record: {error}.") from error
    if not isinstance(state, dict):
        raise ValueError(f"{path} is not a trial record: it holds {type(state).__name__}, not an object.")
    if state.get("schema", SCHEMA) != SCHEMA:
        raise ValueError(f"{path} has schema {state['schema']!r}; this version reads schema {SCHEMA}.")
    # Trials of earlier versions have none.
    if state.pop(checksums.KEY, None) not in (None, checksums.of_state(state)):
        raise checksums.damaged(path)
    wellformed.check(path, state)
    return state


def trial_folders(runs: Path) -> list[Path]:
    """Return the trial folders in `runs`, which may be one itself; earlier attempts are left out."""
    candidates = (
        [runs] if (runs / TRIAL).exists() else sorted(path.parent for path in runs.glob(f"*/{TRIAL}"))
    )
    return [folder for folder in candidates if not _EARLIER.search(folder.name)]


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
