"""Results from several sources at once: folders of trials, single trials, folders of tables."""

import functools
from collections.abc import Callable, Sequence
from pathlib import Path

from usbench import records
from usbench.records import ConfigurationError
from usbench.results import additions, published, tables
from usbench.results.tables import Results


def gather(paths: Sequence[Path], damaged: Callable[[str], None] | None = None) -> Results:
    """Return the results of all trials in `paths`, each once: the last that is finished.

    Args:
        paths: Folders of trials, single trials, or folders of tables that `tables.write` wrote; "published",
            where there is no such folder, stands for the tables that come with the package.
        damaged: Told of each trial whose record is broken or is not there, which is then left out; without
            it, a broken record is an error.

    Raises:
        ConfigurationError: If one of `paths` is no folder, or records in it are broken.
    """
    chosen: dict[Path, set[str] | None] = {}  # folder of trials -> names of trials, None for all
    found = []
    try:
        for path in (folder_of(path) for path in paths):
            if (path / tables.TRIALS).exists():
                found.append(tables.read(path))
            elif (path / records.TRIAL).exists():
                names = chosen.setdefault(path.parent, set())
                if names is not None:
                    names.add(path.name)
            else:
                chosen[path] = None
        found += [tables.collect(folder, damaged=damaged, names=names) for folder, names in chosen.items()]
    except (FileNotFoundError, ValueError) as error:
        raise ConfigurationError(str(error)) from error
    if damaged is not None:
        for folder in (folder for folder, names in chosen.items() if names is None):
            for other in records.without_record(folder):
                damaged(f"{other} has no {records.TRIAL}.")
    return functools.reduce(additions.joined, found)


def folder_of(path: Path) -> Path:
    """Return the folder of one of the paths that `gather` takes.

    Raises:
        FileNotFoundError: If there is none.
    """
    if path == Path(published.NAME) and not path.exists():
        return published.folder()
    return records.existing(path, [published.NAME]).resolve()
