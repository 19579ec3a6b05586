"""Whether a trial was made on its task as it is: the scores of those that were may stand side by side."""

import json
from typing import Any

from usbench.ceilings import ACTIONS
from usbench.records import TrialConfig
from usbench.setting import Setting


def task_environment(task: str) -> dict[str, Any]:
    """Return what a trial on the task as it is has recorded of its environment."""
    found: dict[str, Any] = json.loads(json.dumps(Setting(task=task).record()))
    return found


def is_on_its_task(config: TrialConfig) -> bool:
    """Return whether the environment of a trial is that of its task.

    An agent may be told less than its task tells, and its own last actions.

    Raises:
        ConfigurationError: If the task is not installed.
    """
    task, own = task_environment(config.task), dict(config.environment)
    told, its_own = ({*environment.pop("senses", ())} for environment in (task, own))
    return bool(its_own <= {*told, ACTIONS} and own == task)
