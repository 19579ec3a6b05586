"""usbench: ultrasound guidance tasks for reinforcement learning, and a comparison of algorithms on them.

Importing it registers the tasks' Gymnasium ids. The names below are imported when they are first used, so
that `import usbench` stays light.
"""

import importlib
from typing import TYPE_CHECKING, Any

from usbench.registration import register_row
from usbench.tasks import BUILT_IN

if TYPE_CHECKING:
    from usbench.envs.anatomy.points import PointScatterers, read_points
    from usbench.envs.bmode import Imaging, simulated_bmode
    from usbench.envs.phantom import Phantom
    from usbench.envs.pose import Pose
    from usbench.envs.probe import LinearArray
    from usbench.envs.rf import simulate_rf
    from usbench.envs.scanner import scan
    from usbench.records.loading import load_trial, load_trials
    from usbench.setting import make_env, make_vec_env
    from usbench.setting_parts.toml_files import read_probe
    from usbench.trials.model_loading import load_agent

__version__ = "0.1.0"
__all__ = [
    "Imaging",
    "LinearArray",
    "Phantom",
    "PointScatterers",
    "Pose",
    "load_agent",
    "load_trial",
    "load_trials",
    "make_env",
    "make_vec_env",
    "read_points",
    "read_probe",
    "scan",
    "simulate_rf",
    "simulated_bmode",
]

_MODULES = {
    "Imaging": "usbench.envs.bmode",
    "LinearArray": "usbench.envs.probe",
    "Phantom": "usbench.envs.phantom",
    "PointScatterers": "usbench.envs.anatomy.points",
    "Pose": "usbench.envs.pose",
    "load_agent": "usbench.trials.model_loading",
    "load_trial": "usbench.records.loading",
    "load_trials": "usbench.records.loading",
    "make_env": "usbench.setting",
    "make_vec_env": "usbench.setting",
    "read_points": "usbench.envs.anatomy.points",
    "read_probe": "usbench.setting_parts.toml_files",
    "scan": "usbench.envs.scanner",
    "simulate_rf": "usbench.envs.rf",
    "simulated_bmode": "usbench.envs.bmode",
}

for _row in BUILT_IN.values():
    register_row(_row)


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used (PEP 562)."""
    if name not in _MODULES:
        raise AttributeError(f"module 'usbench' has no attribute {name!r}")
    return getattr(importlib.import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    """Return the public names, for completion."""
    return sorted([*globals(), *__all__])
