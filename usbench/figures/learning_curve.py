"""Figures from records alone; matplotlib's object interface, so that no global state is left behind."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from usbench import records
from usbench.figures import comparison
from usbench.figures import style as drawing
from usbench.records import ConfigurationError, Trial
from usbench.results import tables as results
from usbench.results.tables import Results

LEARNING_CURVE = "learning_curve.png"
SMOOTHING_EPISODES = 40


def write(paths: Sequence[Path], out: Path, formats: Sequence[str] = ("png",)) -> list[Path]:
    """Draw the figures of all trials in `paths` into the folder `out`; return where they are.

    They are those of the leaderboard, and a learning curve of every trial that is itself one of `paths`.

    Args:
        paths: Folders of trials, single trials, or folders of tables that `results.write` wrote.
        out: Folder for the figures, made if need be.
        formats: Some of `drawing.FORMATS`.

    Raises:
        ConfigurationError: If there is nothing to draw, a format is unknown or `out` cannot be a folder.
    """
    for kind in formats:
        if kind not in drawing.FORMATS:
            raise ConfigurationError(f"--format must be among {', '.join(drawing.FORMATS)}, not {kind!r}.")
    known = gather(paths)
    # Also of one that is still running.
    single = [path for path in paths if _has_evaluations(path)]
    if known.curves.empty and not single:
        raise ConfigurationError(
            f"there is no finished trial to draw in {', '.join(repr(str(path)) for path in paths)}."
        )
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigurationError(
            f"the folder {str(out)!r} cannot be made ({error.strerror}): choose another with --out."
        ) from error
    curves = [
        drawing.save(learning_curve_figure(path), out / f"learning_curve_{path.resolve().name}.{kind}")
        for path in single
        for kind in formats
    ]
    return [*curves, *comparison.write(known, out, formats)]


def gather(paths: Sequence[Path]) -> Results:
    """Return the results of all trials in `paths` (see `write`), each once.

    Raises:
        ConfigurationError: If one of `paths` is no folder, or records in it are broken.
    """
    chosen: dict[Path, set[str] | None] = {}  # folder of trials -> names of trials, None for all
    tables = []
    try:
        for path in (path.resolve() for path in paths):
            if (path / results.TRIALS).exists():
                tables.append(results.read(path))
            elif (path / records.TRIAL).exists():
                names = chosen.setdefault(path.parent, set())
                if names is not None:
                    names.add(path.name)
            else:
                chosen[path] = None
        tables += [_only(results.collect(folder), names) for folder, names in chosen.items()]
    except (FileNotFoundError, ValueError) as error:
        raise ConfigurationError(str(error)) from error
    trials = pd.concat([table.trials for table in tables], ignore_index=True)
    curves = pd.concat([table.curves for table in tables], ignore_index=True)
    return Results(
        trials.drop_duplicates("trial", ignore_index=True),
        curves.drop_duplicates(["trial", "kind", "step"], ignore_index=True),
    )


def learning_curve(folder: Path) -> Path:
    """Draw `learning_curve.png` of one trial into its folder and return the path.

    Raises:
        ValueError: If the trial has no evaluations.
    """
    return drawing.save(learning_curve_figure(folder), folder / LEARNING_CURVE)


def learning_curve_figure(folder: Path) -> Figure:
    """Draw the learning curve of one trial.

    Training return (moving mean), evaluation return at every checkpoint (mean and standard deviation over the
    episodes), lines for the random hand and the optimum; the normalised score stands on the right.

    Raises:
        ValueError: If the trial has no evaluations.
    """
    trial = Trial.read(folder)
    evaluations, anchors = trial.evaluations(), trial.anchors
    if evaluations.empty:
        raise ValueError(f"{folder} has no evaluations to draw.")
    figure = Figure(figsize=(7.5, 5), dpi=150, layout="constrained")
    axes = figure.add_subplot()

    episodes = trial.episodes()
    if not episodes.empty:
        smooth = episodes["return"].rolling(SMOOTHING_EPISODES, min_periods=1).mean()
        axes.plot(
            episodes["step"], smooth, color="0.65", label=f"training, mean of {SMOOTHING_EPISODES} episodes"
        )
    # Told apart by line style and marker as well as by colour, so that they survive a grey print.
    for deterministic, label, style, color in (
        (False, "evaluation, stochastic (band: standard deviation)", "-o", "#0072b2"),
        (True, "evaluation, deterministic", "--s", "#d55e00"),
    ):
        chosen = evaluations[evaluations["deterministic"] == deterministic].groupby("step")["return"]
        mean, spread = chosen.mean(), chosen.std(ddof=0)
        axes.plot(mean.index, mean, style, color=color, markersize=4, label=label)
        if not deterministic:
            axes.fill_between(mean.index, mean - spread, mean + spread, color=color, alpha=0.18, linewidth=0)
    axes.axhline(anchors.optimal, color="black", linewidth=1, linestyle="-.", label="optimal")
    axes.axhline(anchors.random, color="black", linewidth=1, linestyle=":", label="random")

    axes.set_title(trial.title, fontsize=11)
    axes.set_xlabel("training steps")
    axes.set_ylabel("return per episode (sum of its rewards)")
    axes.grid(alpha=0.3)
    figure.legend(fontsize=8, loc="outside lower center", ncols=3)
    score = axes.secondary_yaxis(
        "right",
        functions=(
            lambda value: anchors.score(np.asarray(value)),
            lambda value: anchors.return_of(np.asarray(value)),
        ),
    )
    score.set_ylabel("normalised score (0 random, 1 optimal)")
    return figure


def _has_evaluations(folder: Path) -> bool:
    path = folder / records.EVALUATIONS
    return path.exists() and path.stat().st_size > 0


def _only(known: Results, names: set[str] | None) -> Results:
    """Return the results of some trials, of all for None."""
    if names is None:
        return known
    return Results(*(table[table["trial"].isin(names)] for table in (known.trials, known.curves)))
