"""The pools of seeds of the protocol: which seeds serve which purpose, so that none serves two."""

import hashlib
import json
import tomllib
from collections.abc import Mapping
from functools import cache
from itertools import combinations
from pathlib import Path
from typing import Annotated, Any

from annotated_types import Ge
from pydantic import ConfigDict
from pydantic.dataclasses import dataclass

from usbench.checks import ConfigurationError

# The benchmark's own protocol.
PROTOCOL = Path(__file__).with_name("protocol.toml")
STRICT = ConfigDict(strict=True, allow_inf_nan=False, extra="forbid")

Seed = Annotated[int, Ge(0)]


def digest(protocol: Mapping[str, Any]) -> str:
    """Return a checksum of the values of a protocol, whatever the comments in its file say."""
    return hashlib.sha256(json.dumps(protocol, sort_keys=True).encode()).hexdigest()[:16]


@dataclass(frozen=True, config=STRICT)
class Pool:
    """The seeds from `first` to `last`.

    Raises:
        ValueError: If the last comes before the first.
    """

    first: Seed
    last: Seed

    def __post_init__(self) -> None:
        """Check that there are seeds."""
        if self.last < self.first:
            raise ValueError(f"a pool of seeds must not end before it begins, as {self} does")

    def __contains__(self, seed: int) -> bool:
        """Return whether `seed` is in the pool."""
        return self.first <= seed <= self.last

    def __str__(self) -> str:
        """Return the range in words."""
        return f"{self.first} to {self.last}"


@dataclass(frozen=True, config=STRICT)
class Pools:
    """The three pools.

    Raises:
        ValueError: If two of them share seeds.
    """

    development: Pool
    comparison: Pool
    search: Pool

    def __post_init__(self) -> None:
        """Check that no seed is in two pools."""
        for one, other in combinations((self.development, self.comparison, self.search), 2):
            if one.first <= other.last and other.first <= one.last:
                raise ValueError(f"the pools {one} and {other} share seeds")

    def of(self, seed: int) -> str:
        """Return the name of the pool that holds `seed`, "" if none does."""
        pools = {"development": self.development, "comparison": self.comparison, "search": self.search}
        return next((name for name, pool in pools.items() if seed in pool), "")

    def check(self, purpose: str, seed: int) -> int:
        """Return `seed`.

        Raises:
            ConfigurationError: If it is not of the pool for that purpose, "comparison" or "search".
        """
        pool, found = getattr(self, purpose), self.of(seed)
        if seed not in pool:
            what = f"of the pool for {found}" if found else "of no pool"
            raise ConfigurationError(f"a {purpose} takes seeds {pool}, not {seed}, which is {what}.")
        return seed


@cache
def protocol() -> Mapping[str, Any]:
    """Return the values of the benchmark's own protocol; `compare.protocol.read` checks every one of them."""
    return tomllib.loads(PROTOCOL.read_text(encoding="utf-8"))


@cache
def own() -> Pools:
    """Return the pools of the benchmark's own protocol."""
    return Pools(**{name: Pool(**pool) for name, pool in protocol()["pools"].items()})
