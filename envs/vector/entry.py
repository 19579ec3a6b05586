"""Entry points of vector environments as Gymnasium registers them: "usbench.envs.vector.entry:PLACE".

Gymnasium calls an entry point, a text "module:name", without telling for which id. Here the name is itself
the place of an environment's class, "package.module.Class", so that a new task needs no entry of its own.
"""

from __future__ import annotations

import importlib
from functools import partial
from typing import Any

from usbench.envs.vector.environment import GuidanceVectorEnv


def __getattr__(place: str) -> Any:
    """Return what makes a vector of the environments at `place` (PEP 562)."""
    module, _, name = place.rpartition(".")
    if not module:
        raise AttributeError(f"module {__name__!r} has no attribute {place!r}")
    return partial(GuidanceVectorEnv, getattr(importlib.import_module(module), name))
