"""Trials in, one page out: a file that works offline and has the same bytes from the same records."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import jinja2

from usbench import records, suite
from usbench.atomic import atomic_file
from usbench.figures import style
from usbench.own_task import is_on_its_task
from usbench.records import ConfigurationError, Trial
from usbench.report import agents, pictures, poses, tables, text
from usbench.results import leaderboard, scores, sources, studies, verdict
from usbench.results.protocol import further
from usbench.results.tables import Results
from usbench.setting import Setting

Tell = Callable[[str], None]
ENDINGS = (".html",)


def check(runs: Path, out: Path) -> Path:
    """Return where the page goes, if trials or studies can be read and a page written there.

    Raises:
        ConfigurationError: If not; one sentence says why.
    """
    try:
        records.existing(runs)
    except FileNotFoundError as error:
        raise ConfigurationError(str(error)) from error
    if not records.trial_folders(runs) and not studies.folders(runs):
        raise ConfigurationError(
            f"{str(runs)!r} holds no trials (earlier attempts aside) and no studies: usbench run, compare "
            "and guide make them."
        )
    return style.check_file(out, ENDINGS)


def write(runs: Path, out: Path, tell: Tell = lambda _: None) -> Path:
    """Write the page of all trials and studies in `runs`, or of a single one, and return its path.

    Args:
        runs: Where the trials are.
        out: An `.html` file.
        tell: Called with what is being made: the pictures of many agents take minutes.

    Raises:
        ConfigurationError: If there is no trial and no study, a record is broken or nothing can be written.
    """
    out = check(runs, out)
    tell("reading the records")
    damaged: list[str] = []
    known = sources.gather([runs], damaged.append)
    if known.trials.empty and studies.gather(runs).empty:
        for sentence in damaged[1:]:
            tell(f"left out: {sentence}")
        raise ConfigurationError(
            damaged[0] if damaged else f"no trial and no study in {str(runs)!r} has begun."
        )
    for sentence in damaged:
        tell(f"left out: {sentence}")
    studied = tables.studied(runs)
    if (runs / records.TRIAL).is_file():
        runs = runs.resolve().parent
    tell("drawing the comparison")
    # Not where this reader keeps the trials.
    content: dict[str, Any] = {"damaged": [told.replace(f"{runs.resolve()}/", "") for told in damaged]}
    content |= _comparison(runs, known) | _recorded(runs, known) | _seen(runs, known, tell)
    content["studies"] = studied
    with atomic_file(out) as file:
        file.write(_page(content).encode())
    return out


def _page(content: dict[str, Any]) -> str:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("usbench.report"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["inline"] = text.inline
    return environment.get_template("report.html").render(content)


def _comparison(runs: Path, known: Results) -> dict[str, Any]:
    """Return the leaderboard's parts and figures; trials with changed environments are told apart."""
    configs = {name: Trial.read(runs / name).config for name in known.trials["trial"]}
    changed = [name for name, config in configs.items() if not is_on_its_task(config)]
    sections, figures = text.sections(known, changed), pictures.compared(known)
    return {
        "verdict": text.inline(verdict.text(known)),
        "reading": leaderboard.READING,
        "n_trials": len(known.trials),
        "n_finished": int((known.trials["status"] == "finished").sum()),
        "sections": sections,
        "cells": _cells(known, sections),
        "figures": figures,
        "parts": {name.removesuffix("scores"): _part(name) for name in figures if name.endswith("scores")},
    }


def _cells(known: Results, sections: Iterable[str]) -> dict[str, str]:
    """Return the titles of those sections that are about a cell, in their order."""
    titles = {
        cell.name: f"{suite.TASKS[cell.task].guidance.title}, noise {cell.noise:g}"
        for cell in scores.cells_of(known.trials)
    }
    found = {}
    for section in sections:
        # A cell of a further table has the table's name behind its own.
        cell, colon, table = section.partition(": ")
        if cell in titles:
            found[section] = f"{titles[cell]}{colon}{table}"
    return found


def _part(name: str) -> str:
    """Return what captions say of the part of the results that a figure of scores is about."""
    table = name.removesuffix("_scores")
    return f"Further table {table}: " if table in further.names() else ""


def _recorded(runs: Path, known: Results) -> dict[str, Any]:
    """Return the tables that need more than the results."""
    return {
        "endings": tables.endings(runs, known),
        "settings": tables.settings(known),
        "environments": tables.environments(runs, known),
        "trials": tables.trials(known),
    }


def _seen(runs: Path, known: Results, tell: Tell) -> dict[str, Any]:
    """Return what is looked at, agent by agent, and what agents see."""
    chosen = agents.shown(known)
    tell("looking at the frames")
    settings = {task: Setting(task=task) for task in sorted({one.task for one in chosen})}
    looks = {task: poses.look(setting) for task, setting in settings.items() if not poses.silence(setting)}
    cards = []
    for number, one in enumerate(chosen, 1):
        tell(f"agent {number} of {len(chosen)}: {one.agent} on {one.task}")
        cards.append(agents.card(runs, one, looks.get(one.task)))
    titles = {task: setting.guidance.title for task, setting in settings.items()}
    return {
        "titles": titles,
        "cards": cards,
        "accuracy": agents.accuracy_table(cards, titles, poses.ALIKE),
        "other_frames": [
            card.shown.trial
            for card in cards
            if not poses.silence(card.setting)
            and not looks[card.setting.task].digest.startswith(card.shown.frames)
        ],
        "overview": poses.overview(looks) if looks else None,
        "pairs": {task: poses.pairs(own) for task, own in looks.items()},
    }
