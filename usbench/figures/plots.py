"""The figures of any set of trials, as files in a folder."""

from collections.abc import Callable, Sequence
from pathlib import Path

import pandas as pd

from usbench import records
from usbench.figures import comparison, learning_curve, style, tuning
from usbench.records import ConfigurationError, Trial
from usbench.results import sources
from usbench.results.protocol import tuning as searched


def write(
    paths: Sequence[Path],
    out: Path,
    formats: Sequence[str] = ("png",),
    damaged: Callable[[str], None] | None = None,
) -> list[Path]:
    """Draw the figures of all trials in `paths` into the folder `out`; return the files.

    They are those of the leaderboard, that of a search where tables have one, and a learning curve of every
    training that is itself one of `paths`.

    Args:
        paths: Folders of trials, single trials, or folders of tables, as `sources.gather` takes them.
        out: Folder for the figures, made if need be.
        formats: Some of `style.FORMATS`; one that is there twice counts once.
        damaged: Told of each trial whose record is broken, which is then left out; without it, an error.

    Raises:
        ConfigurationError: If there is nothing to draw, a format is unknown or `out` cannot be written.
    """
    for kind in formats:
        if kind not in style.FORMATS:
            raise ConfigurationError(
                f"the format of a figure must be one of {', '.join(style.FORMATS)}, not {kind!r}."
            )
    formats = list(dict.fromkeys(formats))
    known = sources.gather(paths, damaged)
    single = _single(paths, damaged is None)
    if known.curves.empty and not single:
        raise ConfigurationError(
            f"there is no finished trial to draw in {', '.join(repr(str(path)) for path in paths)}."
        )
    records.check_writable(out, "folder")
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise records.unwritable(out, error, "folder") from error
    curves = [
        style.save(learning_curve.draw(trial), out / f"learning_curve_{trial.name}.{kind}")
        for trial in single
        for kind in formats
    ]
    return [*curves, *comparison.write(known, out, formats), *_searches(paths, out, formats)]


def _single(paths: Sequence[Path], strictly: bool) -> list[Trial]:
    """Return the trials among `paths` that learn, also one that is still running.

    Of those with the same name it is the last that is finished, as in `sources.gather`.
    """
    found: dict[str, Trial] = {}
    for trial in filter(None, (_readable(path, strictly) for path in paths)):
        kept = found.get(trial.name)
        if trial.config.steps and (kept is None or trial.status == "finished" or kept.status != "finished"):
            found[trial.name] = trial
    return list(found.values())


def _searches(paths: Sequence[Path], out: Path, formats: Sequence[str]) -> list[Path]:
    """Draw a figure of each search that differs from those before it; the second is called `tuning_2`."""
    found: list[pd.DataFrame] = []
    for table in (searched.read(sources.folder_of(path)) for path in paths):
        if not (table.empty or any(table.equals(other) for other in found)):
            found.append(table)
    files = []
    for number, table in enumerate(found, 1):
        name = tuning.NAME if number == 1 else f"{tuning.NAME}_{number}"
        files += tuning.write(table, out, formats, name)
    return files


def _readable(folder: Path, strictly: bool) -> Trial | None:
    """Return a trial with evaluations; None if it has none, or unless `strictly`, a broken record."""
    path = folder / records.EVALUATIONS
    if not path.exists() or not path.stat().st_size:
        return None
    try:
        trial = Trial.read(folder.resolve())
        if trial.evaluations().empty:  # of one that was killed, or is being written
            return None
    except ValueError:
        if strictly:
            raise
        return None
    return trial
