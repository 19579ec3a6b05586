"""The tasks that a guide shows: what does not fit is refused, without PyTorch, before an address is told."""

from collections.abc import Collection
from typing import Any

from usbench import suite
from usbench.checks import ConfigurationError

GUIDED = tuple(name for name, task in suite.TASKS.items() if task.is_guided)


def check_task(task: Any, allowed: Collection[str] = GUIDED) -> None:
    """Raise ConfigurationError if `task` is not the name of one of the `allowed` tasks."""
    if isinstance(task, str) and task in suite.TASKS and task not in GUIDED:
        raise ConfigurationError(
            f"the guide shows only tasks that move the probe, not {task!r}: allowed are "
            f"{', '.join(map(repr, allowed))}."
        )
    if not isinstance(task, str) or task not in allowed:
        raise ConfigurationError(str(suite.unknown_task(task, allowed)))


def check_shown(name: str, own: str) -> None:
    """Raise ConfigurationError if the agent `name`, trained on the task `own`, has no task of a guide."""
    suite.check_installed(own)
    if own not in GUIDED:
        raise ConfigurationError(
            f"{name!r} is of the task {own!r}: the guide shows only tasks that move the probe."
        )


def check_code(name: str, algo: str) -> None:
    """Raise ConfigurationError if asking the agent `name` would run code from outside the package."""
    if ":" in algo:
        raise ConfigurationError(
            f"{name!r} cannot advise: asking it would run the code of {algo!r}, which is not of this "
            "package; usbench watch shows the episodes that the trial has recorded."
        )


def check_task_of_agent(name: str, own: str, asked: str) -> None:
    """Raise ConfigurationError if the agent `name`, trained on the task `own`, is to advise on another."""
    if own != asked:
        trained, shown = (f"{suite.TASKS[task].guidance.title!r} ({task})" for task in (own, asked))
        raise ConfigurationError(
            f"This model does not fit: {name} was trained on the task {trained}, not on {shown}."
        )
