"""Response tables of all focal depths kept at once, for tasks whose focus moves with every step."""

from __future__ import annotations

from functools import lru_cache

from usbench.envs import response, rf

ENGINES_OWN = 4


def keep(n_depths: int) -> None:
    """Let this process keep the tables of `n_depths` focal depths, some 10 to 60 MB each (18: 330 MB).

    The engine keeps four, enough where all frames of one depth are made together. A table takes a second or
    more to make, so that a probe that refocuses between more depths would wait for one at nearly every step.
    """
    if n_depths > ENGINES_OWN and rf.response_table.cache_parameters()["maxsize"] < n_depths:
        rf.response_table = lru_cache(maxsize=n_depths)(response.response_table.__wrapped__)
