"""Response tables of all focal depths kept at once, for tasks whose focus moves with every step."""

from __future__ import annotations

from functools import lru_cache

from usbench.envs import response, rf

NAME = "response_table"


def keep(n_depths: int) -> None:
    """Let this process keep the tables of `n_depths` focal depths, some 10 to 60 MB each (18: 330 MB).

    The engine keeps four, enough where all frames of one depth are made together. A table takes a second or
    more to make, so that a probe that refocuses between more depths would wait for one at nearly every step.
    """
    if n_depths > getattr(rf, NAME).cache_parameters()["maxsize"]:
        setattr(rf, NAME, lru_cache(maxsize=n_depths)(response.response_table.__wrapped__))
