"""From what a user asks for to the full configuration of a trial, checked."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from usbench import suite
from usbench.agents import zoo
from usbench.agents.hyperparameters import check_seed
from usbench.checks import probability, unknown, whole_number
from usbench.envs.anatomy import Anatomy
from usbench.envs.pose import Pose
from usbench.envs.task import IMAGE, Task, check_reward
from usbench.records import ConfigurationError, TrialConfig
from usbench.trials import anatomy_record

TRUE_REWARD = "normalized"
TRAINED_ON = (TRUE_REWARD, IMAGE)
# An episode's, and more than any trial needs.
MAX_FRAMES = 64
# Settings that are younger than trials which are kept: left out where they change nothing, so that a trial
# has the name that it always had.
LATER = {"attenuation_db_per_cm_mhz": 0.0, "slice_thickness": 10e-3}
# What is recorded with a trial, since its bits depend on them.
PACKAGES = (
    "usbench",
    "gymnasium",
    "stable-baselines3",
    "sb3-contrib",
    "torch",
    "numpy",
    "scipy",
    "numba",
    "opencv-python-headless",
)


def resolve(
    algo: str,
    task: str,
    *,
    noise: float = 0.0,
    seed: int = 0,
    steps: int | None = None,
    n_frames: int = 4,
    reward: str = TRUE_REWARD,
    anatomy: Anatomy | None = None,
    preset: str | None = None,
    overrides: Mapping[str, Any] | None = None,
) -> TrialConfig:
    """Return the full configuration of a trial: every default filled in, every value checked.

    Raises:
        ConfigurationError: If a name is unknown or a value is not allowed; one sentence says which.
    """
    try:
        if task not in suite.TASKS:
            raise unknown("task", task, suite.TASKS)
        hyperparameters = zoo.hyperparameters(algo, task, preset=preset, overrides=overrides or {})
        # Nothing is forgotten over the task's whole budget.
        if "buffer_size" in hyperparameters and "buffer_size" not in (overrides or {}):
            budget = suite.TASKS[task].steps
            hyperparameters["buffer_size"] = max(int(hyperparameters["buffer_size"]), budget)
        noise = probability("noise", noise)
        seed = check_seed(seed)
        steps = whole_number("steps", suite.TASKS[task].steps if steps is None else steps, low=1)
        n_frames = whole_number("n_frames", n_frames, 1, MAX_FRAMES)
        check_reward(reward, suite.TASKS[task].guidance, TRAINED_ON)
        if anatomy is not None:
            _check_takes(task, anatomy)
        plain: Any = suite.make_env(task, noise, reward=reward, anatomy=anatomy).unwrapped
        if anatomy is not None:
            _check_reached(anatomy.target, plain.task)
    except (ValueError, TypeError) as error:
        raise ConfigurationError(str(error)) from error
    scene = {name: _recorded(getattr(plain, name)) for name in plain.scene}
    return TrialConfig(
        task=task,
        algo=algo,
        noise=noise,
        seed=seed,
        n_frames=n_frames,
        steps=steps if zoo.entry(algo).learns else 0,
        hyperparameters=hyperparameters,
        environment={
            "id": suite.TASKS[task].env_id,
            **(scene if anatomy is None else scene | anatomy_record.plain(anatomy)),
            # What is trained on; the score is always that of the true reward.
            **({} if reward == TRUE_REWARD else {"reward": reward}),
        },
    )


def _check_takes(task: str, anatomy: Anatomy) -> None:
    """Raise ValueError if the task draws its phantoms; what else does not fit, its environment refuses."""
    if suite.TASKS[task].phantoms:
        allowed = [
            name
            for name, row in suite.TASKS.items()
            if not (row.phantoms or row.guidance.reward_from_frames)
            and (anatomy.has_focus or not row.guidance.moves_focus)
        ]
        raise ValueError(
            f"the task {task!r} draws its phantoms and takes no --phantom of one's own: allowed are "
            f"{', '.join(map(repr, allowed))}."
        )


def _check_reached(target: Pose, task: Task) -> None:
    """Raise ValueError if no pose of the task is its goal."""
    if not any(task.is_success(pose, target) for pose in task.states):
        nearest = max(task.states, key=lambda pose: task.reward(pose, target, TRUE_REWARD))
        raise ValueError(
            f"the target must be a pose that the task {task.name!r} reaches, as the nearest, {nearest}, not "
            f"{target}."
        )


def _recorded(part: Any) -> dict[str, Any]:
    """Return a part of the scene as plain values."""
    values = asdict(part)
    return {name: value for name, value in values.items() if name not in LATER or value != LATER[name]}
