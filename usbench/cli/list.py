"""`usbench list`: show tasks, algorithms and their defaults."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import Any


def add(subparsers: Any, debug: argparse.ArgumentParser) -> None:
    """Add the command to the command line; `debug` is what all commands share."""
    show = subparsers.add_parser("list", parents=[debug], help="show tasks, algorithms and their defaults")
    show.set_defaults(call=_call)


def _call(args: argparse.Namespace) -> None:
    """Show tasks, algorithms and their defaults."""
    print_suite()


def print_suite() -> None:
    """Print the tasks, the algorithms and their defaults."""
    from rich.console import Console
    from rich.table import Table

    from usbench import suite
    from usbench.agents.plugins import registered
    from usbench.agents.zoo import ZOO

    tasks = Table(title="tasks")
    # Sentences may be broken, names to be typed may not.
    for name in ("task", "Gymnasium id", "title", "steps", "evaluation\nepisodes"):
        tasks.add_column(name, no_wrap=name != "title")
    for name, task in suite.TASKS.items():
        episodes = str(len(suite.evaluation_episodes(name)))
        tasks.add_row(name, task.env_id, task.guidance.title, str(task.steps), episodes)
    algorithms = Table(title="algorithms")
    for name in ("name", "defaults (--set)", "where they differ"):
        algorithms.add_column(name, no_wrap=name != "where they differ")
    for name, entry in ZOO.items():
        differing = [f"--task {task}: {_settings(values, ', ')}" for task, values in entry.tasks.items()]
        differing += [
            f"--preset {preset}: {_settings(values, ', ')}" for preset, values in entry.presets.items()
        ]
        defaults = _settings(entry.hyperparameters, "\n") if entry.learns else "does not learn"
        algorithms.add_row(name, defaults, "\n".join(differing))
    for name, place in registered().items():
        algorithms.add_row(name, f"from {place}", "")
    console = Console()
    console.print(tasks)
    console.print(algorithms)


def _settings(values: Mapping[str, float], separator: str) -> str:
    """Return hyperparameters as `--set` takes them."""
    texts = {
        name: str(value).lower() if isinstance(value, bool) else f"{value:g}"
        for name, value in values.items()
    }
    return separator.join(f"{name}={text}" for name, text in texts.items())
