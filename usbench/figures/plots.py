"""The figures of any set of trials, as files in a folder."""

from collections.abc import Callable, Sequence
from pathlib import Path

from usbench import records
from usbench.figures import comparison, learning_curve, style, tuning
from usbench.records import ConfigurationError, Trial
from usbench.results import sources


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
    # Also of a trial that is still running; of those with the same name the last, as in `gather`.
    readable = filter(None, (_readable(path, damaged is None) for path in paths))
    single = {trial.name: trial for trial in readable if trial.config.steps}.values()
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
    searched = tuning.write([sources.folder_of(path) for path in paths], out, formats)
    return [*curves, *comparison.write(known, out, formats), *searched]


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
