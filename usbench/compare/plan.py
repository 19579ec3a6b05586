"""The trials that a comparison of algorithms takes."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

from usbench import suite
from usbench.ceilings import ACTIONS
from usbench.checks import as_configuration_error, whole_number
from usbench.compare.protocol import Extra, Protocol
from usbench.own_task import is_on_its_task
from usbench.records import ConfigurationError, TrialConfig
from usbench.results.agents import REFERENCE_POLICIES
from usbench.results.protocol import unseen
from usbench.trials.configuration import resolve
from usbench.words import with_network


def by_protocol(
    protocol: Protocol,
    table: str | None = None,
    *,
    algos: Sequence[str] | None = None,
    tasks: Sequence[str] | None = None,
    noises: Sequence[Any] | None = None,
    n_seeds: Any = None,
    steps: Any = None,
    n_frames: Any = None,
    senses: Sequence[str] | None = None,
) -> list[TrialConfig]:
    """Return the trials of the protocol's grid, or of one of its further tables.

    An argument that is None takes its value from the protocol.

    `n_frames` and `senses` are what agents that learn see and are told, in place of the tasks' own; both are
    for trials of the table of unseen phantoms.

    Raises:
        ConfigurationError: If a name is unknown, a value is not allowed, the pool has fewer seeds, the
            hyperparameters were chosen under another protocol, or agents must not see or be told something
            else; one sentence says which.
    """
    own = {name: one for name, one in (("n_frames", n_frames), ("senses", senses)) if one is not None}
    grid = protocol.comparison
    extra = Extra("", grid.noises, grid.seeds) if table is None else grid.extra(table)
    algos = algos or extra.rows or grid.rows
    protocol.check_winners(algos)
    if extra.network is not None:
        algos = [algo if algo in REFERENCE_POLICIES else with_network(algo, extra.network) for algo in algos]
    setting = {} if extra.n_frames is None else {"n_frames": extra.n_frames}
    planned = plan(
        algos,
        tasks or extra.tasks or grid.tasks,
        noises or extra.noises,
        protocol.comparison_seeds(extra.seeds if n_seeds is None else positive("seeds", n_seeds)),
        steps,
        extra.budgets,
        of_learners=own,
        **setting,
    )
    if own:
        _check_open(planned, " and ".join(own))
    return planned


def _check_open(planned: Sequence[TrialConfig], names: str) -> None:
    """Raise ConfigurationError unless agents that learn may choose what they see and are told."""
    learners = {config.task: config for config in planned if config.steps}
    for task, config in learners.items():
        if not unseen.has(task, config.steps):
            raise ConfigurationError(
                f"{names} cannot be chosen on {task!r} with {config.steps} steps: they can on "
                f"unseen phantoms alone, with the steps of the table {unseen.NAME!r} (docs/submit.md)."
            )
        if not is_on_its_task(config):
            told = ", ".join(map(repr, (*suite.TASKS[task].senses, ACTIONS)))
            raise ConfigurationError(f"agents of {task!r} may be told {told}, and nothing else.")
    if not learners:
        raise ConfigurationError(f"{names} cannot be chosen where no agent learns.")


def plan(
    algos: Sequence[str],
    tasks: Sequence[str],
    noises: Sequence[Any],
    seeds: Sequence[int],
    steps: Any = None,
    budgets: int = 1,
    *,
    of_learners: Mapping[str, Any] = MappingProxyType({}),
    **setting: Any,
) -> list[TrialConfig]:
    """Return the trials of all algorithms on all tasks with all noises and seeds.

    Cells come one after the other, and within a cell the seeds: a comparison that is stopped has whole cells,
    and in the last one has done the same for every algorithm. Where `steps` is None, each task is trained
    with `budgets` times its budget. `setting` goes to `resolve`, for agents that learn with `of_learners`.

    Raises:
        ConfigurationError: If a name is unknown or a value is not allowed; one sentence says which.
    """
    learners = [algo for algo in algos if algo not in REFERENCE_POLICIES]
    cells = [(task, noise) for noise in noises for task in tasks]
    planned = [
        resolve(algo, task, noise=noise, **setting) for algo in REFERENCE_POLICIES for task, noise in cells
    ] + [
        resolve(
            algo,
            task,
            noise=noise,
            seed=seed,
            steps=_budget(task, budgets) if steps is None else steps,
            **{**setting, **of_learners},
        )
        for task, noise in cells
        for seed in seeds
        for algo in learners
    ]
    return list({config.folder_name: config for config in planned}.values())


def _budget(task: str, budgets: int) -> int | None:
    """Return `budgets` times the budget of a task; None where the default serves."""
    return None if budgets == 1 else budgets * suite.TASKS[task].steps


def positive(name: str, value: Any) -> int:
    """Return `value` as a whole number of at least 1; ConfigurationError if it is none."""
    with as_configuration_error():
        return whole_number(name, value, low=1)
