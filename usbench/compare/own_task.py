"""Which trials are on their task as it is, so that their scores may stand side by side."""

import json

from usbench.ceilings import ACTIONS
from usbench.records import TrialConfig
from usbench.setting import Setting


def is_on_its_task(config: TrialConfig) -> bool:
    """Return whether the environment of a trial is that of its task.

    An agent may be told less than its task tells, and its own last actions.

    Raises:
        ConfigurationError: If the task is not installed.
    """
    task, own = (
        json.loads(json.dumps(environment))
        for environment in (Setting(task=config.task).record(), config.environment)
    )
    told, its_own = ({*environment.pop("senses", ())} for environment in (task, own))
    return bool(its_own <= {*told, ACTIONS} and own == task)
