"""The table of tasks, one literal row each, and the rows of other packages.

Text alone: reading the rows of this package imports neither simulator nor torch.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from types import MappingProxyType

from usbench.checks import ConfigurationError, unknown, whole_number
from usbench.words import in_one_line

# Of entry points: name of a task -> "module:name" of its `Row`.
GROUP = "usbench.tasks"


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
        drawn_starts: Number of different starts of the evaluation, drawn from all; 0 takes every start.
        phantoms: Phantoms of the evaluation, none of which training meets; 0 where there is one for both.
        every_frame: Whether all frames of the evaluation's phantoms are simulated before a training, and a
            trial records their digest; else those with which the evaluation's episodes begin, where all would
            be too many.
        single: The same task on one phantom, where this one has many.
        senses: What the agent is told beside the frames by default.
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
    every_frame: bool = True
    single: str = ""
    senses: tuple[str, ...] = ()
    silent: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Refuse counts that there cannot be, and keep the others as whole numbers."""
        least = dict.fromkeys(("n_steps", "steps", "checkpoints", "repeats"), 1)
        for name, low in (least | {"drawn_starts": 0, "phantoms": 0}).items():
            object.__setattr__(self, name, whole_number(name, getattr(self, name), low))


BUILT_IN: Mapping[str, Row] = MappingProxyType(
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
        "pp-tracked": Row(
            env_id="usbench/ProbePlaneTracked-v0",
            entry_point="usbench.envs.tasks.random_phantoms:ProbePlaneTrackedEnv",
            steps=100_000,
            drawn_starts=56,
            phantoms=28,
            senses=("position", "heading"),
        ),
        "exam-random": Row(
            env_id="usbench/ExaminationRandom-v0",
            entry_point="usbench.envs.tasks.random_examination:ExaminationRandomEnv",
            n_steps=24,
            steps=100_000,
            drawn_starts=72,
            phantoms=36,
            every_frame=False,
        ),
        "exam-tracked": Row(
            env_id="usbench/ExaminationTracked-v0",
            entry_point="usbench.envs.tasks.random_examination:ExaminationTrackedEnv",
            n_steps=24,
            steps=100_000,
            drawn_starts=72,
            phantoms=36,
            every_frame=False,
            senses=("position", "focus", "heading"),
        ),
        "setup": Row(
            env_id="usbench/ImagingSetup-v1",
            entry_point="usbench.envs.tasks.imaging_setup:ImagingSetupEnv",
            drawn_starts=56,
            silent=("final_distance_mm", "plane_error_deg"),
        ),
        # Its first version, in which trials of that name were made before.
        "setup-v0": Row(
            env_id="usbench/ImagingSetup-v0",
            entry_point="usbench.envs.tasks.imaging_setup:ImagingSetupV0Env",
            drawn_starts=56,
            silent=("final_distance_mm", "plane_error_deg"),
        ),
    }
)
# The paper's own, on one phantom each.
PAPER = ("fp", "pp")


@cache
def rows() -> Mapping[str, Row]:
    """Return the rows of all tasks by name: those of this package, then those of installed packages.

    Raises:
        ConfigurationError: If the row of another package cannot be used; one sentence says why.
    """
    found = dict(BUILT_IN)
    for point in entry_points(group=GROUP):
        if point.name in found:
            raise ConfigurationError(
                f"{_origin(point)} brings a task {point.name!r}, which exists already: uninstall one of them."
            )
        row = _load(point)
        if row.env_id in (other.env_id for other in found.values()):
            raise ConfigurationError(
                f"the task {point.name!r} of {_origin(point)} has the Gymnasium id of another, "
                f"{row.env_id!r}: mend that package, or uninstall it."
            )
        found[point.name] = row
    return MappingProxyType(found)


def row_of(task: str) -> Row:
    """Return the row of a task.

    Raises:
        ValueError: If there is none of that name, as where the package that brings it is not installed.
    """
    found = rows()
    if task not in found:
        raise unknown("task", task, found)
    return found[task]


def check_installed(task: str) -> None:
    """Check the task that a trial has recorded.

    Raises:
        ConfigurationError: If there is none of that name, as where the package that brought it is gone.
    """
    if task not in rows():
        raise ConfigurationError(f"unknown task {task!r}: no installed package brings it.")


def _load(point: EntryPoint) -> Row:
    try:
        row = point.load()
    except Exception as error:  # whatever a stranger's module does while it is imported
        reason = in_one_line(error, with_type=True)
        raise ConfigurationError(
            f"the task {point.name!r} of {_origin(point)} cannot be imported ({reason}): mend that "
            "package, or uninstall it."
        ) from error
    if not isinstance(row, Row):
        raise ConfigurationError(
            f"the task {point.name!r} of {_origin(point)} must be a usbench.tasks.Row, not {row!r}."
        )
    return row


def _origin(point: EntryPoint) -> str:
    """Return the package of an entry point in words."""
    return f"the package {point.dist.name!r}" if point.dist else f"a package with {point.value!r}"
