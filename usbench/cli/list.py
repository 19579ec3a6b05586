"""`usbench list`: show tasks, algorithms and probes, or everything about one of them."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.table import Table

EXAMPLES = """examples:
  usbench list
      all tasks, algorithms and probes
  usbench list dqn
      the hyperparameters of an algorithm, as --set takes them
  usbench list pp
      the actions and episodes of a task
"""


def add(subparsers: Any, debug: argparse.ArgumentParser) -> None:
    """Add the command to the command line; `debug` is what all commands share."""
    show = subparsers.add_parser(
        "list",
        parents=[debug],
        epilog=EXAMPLES,
        help="show tasks, algorithms and probes, or everything about one of them",
    )
    show.add_argument("name", nargs="?", metavar="NAME", help="an algorithm or a task (default: all)")
    show.set_defaults(call=_call)


def _call(args: argparse.Namespace) -> None:
    """Show all tasks, algorithms and probes, or one algorithm or task."""
    from rich.console import Console

    tables = _everything() if args.name is None else [_one(args.name)]
    for table in tables:
        Console().print(table)


def _everything() -> list[Table]:
    """Return the tables of tasks, algorithms and probes: a line for each."""
    from usbench import suite
    from usbench.agents.plugins import registered
    from usbench.agents.zoo import ZOO
    from usbench.setting_parts import toml_files

    tasks = _table(
        "tasks: usbench list TASK shows actions and Gymnasium id", "task", "training steps", "title"
    )
    for name, task in suite.TASKS.items():
        tasks.add_row(name, str(task.steps), task.guidance.title)
    algorithms = _table(
        "algorithms: usbench list ALGORITHM shows the hyperparameters", "algorithm", "what it is"
    )
    for name, entry in ZOO.items():
        algorithms.add_row(name, entry.title)
    for name, place in registered(ZOO).items():
        algorithms.add_row(name, f"from {place}")
    probes = _table("probes, for --probe: usbench defaults PROBE shows the fields", "probe", "what it is")
    for name, title in toml_files.presets().items():
        probes.add_row(name, title)
    return [tasks, algorithms, probes]


def _one(name: str) -> Table:
    """Return everything about an algorithm or a task.

    Raises:
        ConfigurationError: If there is none of that name; the message says the closest.
    """
    from usbench import released, suite
    from usbench.agents import plugins, zoo
    from usbench.checks import ConfigurationError, unknown
    from usbench.setting_parts import toml_files
    from usbench.words import network_apart

    if name in suite.TASKS:
        return _task(name)
    if name in released.names():
        raise ConfigurationError(
            f"{name!r} is neither algorithm nor task but a trained agent that comes with the package: "
            f"usbench watch {name}."
        )
    if name.lower() in toml_files.presets():
        raise ConfigurationError(
            f"{name!r} is neither algorithm nor task but a probe: usbench defaults {name} shows its fields."
        )
    known = [*zoo.ZOO, *plugins.registered(zoo.ZOO)]
    if name not in known and ":" not in name and not network_apart(name)[1]:
        raise ConfigurationError(str(unknown("algorithm or task", name, [*known, *suite.TASKS])))
    return _algorithm(name)


def _task(name: str) -> Table:
    from usbench import suite

    row = suite.TASKS[name]
    table = _table(row.guidance.title, "", "")
    table.add_row("task", name)
    table.add_row("Gymnasium id", row.env_id)
    for number, action in enumerate(row.guidance.actions):
        table.add_row(f"action {number}", action.name)
    table.add_row("steps of an episode", str(row.guidance.n_steps))
    table.add_row("training steps", str(row.steps))
    table.add_row("evaluation episodes", str(len(suite.evaluation_episodes(name))))
    return table


def _algorithm(name: str) -> Table:
    from usbench.agents import zoo
    from usbench.agents.hyperparameters import RANGES, as_set
    from usbench.checks import as_configuration_error

    with as_configuration_error():
        entry = zoo.entry(name)
    table = _table(entry.title or name, "", "")
    table.add_row("algorithm", name)
    table.add_row("class", entry.cls)
    if not entry.compared:
        table.add_row("comparison", "no row of it: made for unseen phantoms")
    if not entry.learns:
        table.add_row("--set", "nothing: it does not learn")
    else:
        said = {**entry.hyperparameters, **entry.options}
        declared = {name: value for name, value in said.items() if name in RANGES}
        fixed = [f"{name}={value}" for name, value in said.items() if name not in RANGES]
        for what, lines in (("--set, defaults", as_set(declared)), ("fixed", fixed)):
            if lines:
                table.add_row(what, "\n".join(lines))
    for task, values in entry.tasks.items():
        table.add_row(f"--task {task}", "\n".join(as_set(values)))
    for preset, values in entry.presets.items():
        table.add_row(f"--preset {preset}", "\n".join(as_set(values)))
    return table


def _table(title: str, *headings: str) -> Table:
    """Return an empty table; only the last column may be broken, names to be typed may not."""
    from rich import box
    from rich.table import Table

    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, show_header=any(headings))
    for heading in headings:
        table.add_column(heading, no_wrap=heading != headings[-1] or not any(headings))
    return table
