"""The protocol of the comparison, read from a TOML file and checked: pools of seeds, search, grid."""

import json
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

from annotated_types import Ge, Le, Len
from pydantic import TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from usbench import suite
from usbench.agents.search_space import SPACES, candidates
from usbench.agents.zoo import entry, winners
from usbench.checks import misfit, unknown
from usbench.records import ConfigurationError
from usbench.seed_pools import PROTOCOL, STRICT, Pools, Seed, digest
from usbench.seed_pools import own as own_pools
from usbench.seed_pools import protocol as own_protocol

PATH = PROTOCOL
Positive = Annotated[int, Ge(1)]
Names = Annotated[tuple[str, ...], Len(1)]
Noises = Annotated[tuple[Annotated[float, Ge(0), Le(1)], ...], Len(1)]


@dataclass(frozen=True, config=STRICT)
class Rung:
    """One round of the search: steps and seeds of its trials, and how many candidates go on."""

    steps: Positive
    seeds: Annotated[tuple[Seed, ...], Len(1)]
    keep: Positive


@dataclass(frozen=True, config=STRICT)
class Search:
    """The search for hyperparameters, the same for every row."""

    rows: Names
    candidates: Annotated[int, Ge(1), Le(1000)]
    tasks: Names
    noises: Noises
    rungs: Annotated[tuple[Rung, ...], Len(1)]

    def n_trials(self) -> tuple[int, ...]:
        """Return how many trials of one row each rung has."""
        cells = len(self.tasks) * len(self.noises)
        counts = (self.candidates, *(rung.keep for rung in self.rungs))
        return tuple(n * cells * len(rung.seeds) for n, rung in zip(counts, self.rungs, strict=False))


@dataclass(frozen=True, config=STRICT)
class Extra:
    """A further table: the grid with what is named here in place of the grid's.

    Attributes:
        name: Its name.
        noises: Noises.
        seeds: Number of seeds.
        rows: Algorithms; None for those of the grid.
        tasks: Tasks; None for those of the grid.
        n_frames: Frames in one observation; None for the default.
        network: Name of the network; None for the paper's trunk.
        budgets: How often the task's budget is trained.
    """

    name: str
    noises: Noises
    seeds: Positive
    rows: Names | None = None
    tasks: Names | None = None
    n_frames: Positive | None = None
    network: Literal["residual"] | None = None
    budgets: Positive = 1


@dataclass(frozen=True, config=STRICT)
class Comparison:
    """The grid of the comparison and its further tables; seeds are counted from the first of the pool."""

    rows: Names
    tasks: Names
    noises: Noises
    seeds: Positive
    extras: tuple[Extra, ...] = ()

    def extra(self, name: str) -> Extra:
        """Return the further table of that name; ConfigurationError if there is none."""
        found = {extra.name: extra for extra in self.extras}
        if name not in found:
            raise ConfigurationError(str(unknown("table of the protocol", name, found)))
        return found[name]


@dataclass(frozen=True, config=STRICT)
class _Content:
    pools: Pools
    search: Search
    comparison: Comparison


@dataclass(frozen=True, config=STRICT)
class Protocol(_Content):
    """A protocol; `digest` is a checksum of the file's values, whatever its comments say."""

    digest: str

    def comparison_seeds(self, n: int) -> tuple[int, ...]:
        """Return the first `n` seeds of the comparison; ConfigurationError if the pool has fewer."""
        pool = self.pools.comparison
        most = pool.last - pool.first + 1
        if n > most:
            raise ConfigurationError(f"a comparison has at most {most} seeds ({pool}), not {n}.")
        return tuple(range(pool.first, pool.first + n))

    def check_winners(self, rows: Sequence[str]) -> None:
        """Raise ConfigurationError if hyperparameters of `rows` were chosen under another protocol."""
        for row in rows:
            if winners().get(row, {}).get("protocol", self.digest) != self.digest:
                raise ConfigurationError(
                    f"the hyperparameters of {row} were chosen under another protocol: put that protocol "
                    "back, or search anew."
                )

    @property
    def is_of_the_package(self) -> bool:
        """Return whether it is the benchmark's own protocol."""
        return self.digest == digest(own_protocol())


def read(path: Path = PATH) -> Protocol:
    """Return the protocol in a TOML file.

    Raises:
        ConfigurationError: If the file cannot be read or says something that is not allowed; one sentence.
    """
    try:
        values = tomllib.loads(path.read_text(encoding="utf-8"))
        content = _ADAPTER.validate_json(json.dumps(values))
        _check(content)
    except OSError as error:
        raise ConfigurationError(
            f"the protocol file {str(path)!r} cannot be read ({error.strerror})."
        ) from error
    except ValidationError as error:
        raise ConfigurationError(
            f"the protocol file {str(path)!r} cannot be used: {misfit(error)}."
        ) from None
    except (TypeError, ValueError) as error:  # TOML has dates, and JSON has none
        reason = str(error).removesuffix(".")
        raise ConfigurationError(f"the protocol file {str(path)!r} cannot be used: {reason}.") from error
    return Protocol(content.pools, content.search, content.comparison, digest(values))


_ADAPTER = TypeAdapter(_Content)


def _check(content: _Content) -> None:
    """Raise ValueError if parts do not fit together; the message is one sentence."""
    search, comparison = content.search, content.comparison
    for name in search.rows:
        if name not in SPACES:
            raise unknown("algorithm with a search space", name, SPACES)
        candidates(name, search.candidates)  # refuses more than its space holds
    extras = comparison.extras
    for name in (*comparison.rows, *(name for extra in extras for name in extra.rows or ())):
        entry(name)
    of_extras = [name for extra in extras for name in extra.tasks or ()]
    for name in (*search.tasks, *comparison.tasks, *of_extras):
        if name not in suite.TASKS:
            raise suite.unknown_task(name)
    for name in search.tasks:
        if suite.TASKS[name].phantoms:
            single = [other for other, row in suite.TASKS.items() if not row.phantoms]
            raise ValueError(
                f"{name} is evaluated on the phantoms that comparisons test with, which must not choose "
                f"hyperparameters: search on {suite.TASKS[name].single or ', '.join(single)}."
            )
    seeds = [seed for rung in search.rungs for seed in rung.seeds]
    kept = own_pools().comparison
    for seed in seeds:
        content.pools.check("search", seed)
        if seed in kept:
            raise ValueError(
                f"a search takes no seed from {kept}, which is kept for comparisons, as {seed} is."
            )
    if len(set(seeds)) < len(seeds):
        raise ValueError(f"the rungs share seeds ({', '.join(map(str, seeds))}): each takes others.")
    for n_before, rung in zip(
        (search.candidates, *(r.keep for r in search.rungs)), search.rungs, strict=False
    ):
        if rung.keep > n_before:
            raise ValueError(f"a rung of {n_before} candidates cannot keep {rung.keep}.")
    if search.rungs[-1].keep != 1:
        raise ValueError(f"the last rung must keep 1 candidate, not {search.rungs[-1].keep}.")
    first = content.pools.comparison.first
    for n_seeds in (comparison.seeds, *(extra.seeds for extra in extras)):
        content.pools.check("comparison", first + n_seeds - 1)
