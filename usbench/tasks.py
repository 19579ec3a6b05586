"""The table of tasks, one literal row each. Text alone: reading it imports neither simulator nor torch."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType


@dataclass(frozen=True, kw_only=True)
class Row:
    """A task: its environment, what is trained, and what is evaluated.

    Attributes:
        env_id: Gymnasium id of the environment.
        entry_point: Its class, "module:name".
        n_steps: Length of an episode.
        steps: Training budget in environment steps (251 updates of 64 steps in the paper).
        checkpoints: Evaluations after the one before training, spread evenly over the budget.
        repeats: Evaluation episodes from each start pose.
        drawn_starts: In place of that, evaluation episodes from so many different starts; 0 for all of them.
        phantoms: Phantoms of the evaluation, none of which training meets; 0 where there is one for both.
        single: The same task on one phantom, where this one has many.
        silent: Columns of the leaderboard that say nothing about it.
    """

    env_id: str
    entry_point: str
    n_steps: int = 16
    steps: int = 16_064
    checkpoints: int = 10
    repeats: int = 1
    drawn_starts: int = 0
    phantoms: int = 0
    single: str = ""
    silent: tuple[str, ...] = ()


ROWS: Mapping[str, Row] = MappingProxyType(
    {
        "fp": Row(
            env_id="usbench/FocalPoint-v0",
            entry_point="usbench.envs.tasks.focal_point:FocalPointEnv",
            repeats=6,
            silent=("plane_error_deg",),
        ),
        "pp": Row(
            env_id="usbench/ProbePlane-v0",
            entry_point="usbench.envs.tasks.probe_plane:ProbePlaneEnv",
            repeats=2,
        ),
        "fp-random": Row(
            env_id="usbench/FocalPointRandom-v0",
            entry_point="usbench.envs.tasks.random_phantoms:FocalPointRandomEnv",
            repeats=6,
            phantoms=27,
            single="fp",
            silent=("plane_error_deg",),
        ),
        "pp-random": Row(
            env_id="usbench/ProbePlaneRandom-v0",
            entry_point="usbench.envs.tasks.random_phantoms:ProbePlaneRandomEnv",
            drawn_starts=56,
            phantoms=28,
            single="pp",
        ),
        "exam": Row(
            env_id="usbench/Examination-v0",
            entry_point="usbench.envs.tasks.examination:ExaminationEnv",
            n_steps=24,
            steps=32_128,
            drawn_starts=72,
        ),
        "exam-stop": Row(
            env_id="usbench/ExaminationStop-v0",
            entry_point="usbench.envs.tasks.examination:ExaminationStopEnv",
            n_steps=24,
            steps=32_128,
            drawn_starts=72,
        ),
        "setup": Row(
            env_id="usbench/ImagingSetup-v0",
            entry_point="usbench.envs.tasks.imaging_setup:ImagingSetupEnv",
            drawn_starts=56,
            silent=("final_distance_mm", "plane_error_deg"),
        ),
    }
)
# The paper's own, on one phantom each.
PAPER = ("fp", "pp")
