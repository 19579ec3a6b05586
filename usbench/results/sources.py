"""Where results come from: folders of trials, single trials, folders of tables, the tables in the package.

The tables of the committed leaderboard come with the package: to add to them, nobody needs a clone.
"""

import functools
from collections.abc import Callable, Sequence
from importlib import resources
from pathlib import Path

from usbench import records
from usbench.atomic import atomic_file
from usbench.records import ConfigurationError
from usbench.results import additions, collecting, tables
from usbench.results.tables import Results

# What stands for the tables in the package where a folder of trials or of tables is named.
PUBLISHED = "published"


def gather(paths: Sequence[Path], damaged: Callable[[str], None] | None = None) -> Results:
    """Return the results of all trials in `paths`, each once: the one that is finished.

    Of a trial that several of them have, the record in its folder counts, or else that of the last tables.

    Args:
        paths: Folders of trials, single trials, or folders of tables that `tables.write` wrote; "published",
            where there is no such folder, stands for the tables that come with the package.
        damaged: Told of each trial whose record is broken or is not there, which is then left out; without
            it, a broken record is an error.

    Raises:
        ConfigurationError: If there is none, one of `paths` is no folder, records in it are broken, or two
            different trials have one name.
    """
    if not paths:
        raise ConfigurationError(
            "there is nothing to read: name a folder of trials, a trial, or a folder of tables."
        )
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
        found += [
            collecting.collect(folder, damaged=damaged, names=names) for folder, names in chosen.items()
        ]
    except (FileNotFoundError, ValueError) as error:
        raise ConfigurationError(str(error)) from error
    if damaged is not None:
        for folder in (folder for folder, names in chosen.items() if names is None):
            for other in records.without_record(folder):
                damaged(f"{other} has no {records.TRIAL}.")
    known = functools.reduce(additions.joined, found)
    additions.check_names(known.trials)
    return known


def folder_of(path: Path) -> Path:
    """Return the folder of one of the paths that `gather` takes.

    Raises:
        FileNotFoundError: If there is none.
    """
    if path == Path(PUBLISHED) and not path.exists():
        return published()
    return records.existing(path, [PUBLISHED]).resolve()


def published() -> Path:
    """Return the folder of the tables that come with the package."""
    return Path(str(resources.files("usbench.published").joinpath(tables.TRIALS))).parent


def own_or_published(own: Path) -> Path:
    """Return the folder `own` if it holds tables, else that of the tables that come with the package."""
    return own if (own / tables.TRIALS).exists() else published()


def bring_published(own: Path) -> bool:
    """Copy the tables that come with the package into the folder `own`, if it holds none; return whether.

    The names of those trials that are not verified come with them.
    """
    if (own / tables.TRIALS).exists():
        return False
    brought = {
        path.name: path for path in (*published().glob("*.csv"), *published().glob(additions.UNVERIFIED))
    }
    # Last what says that all are there.
    for name in sorted(brought, key=lambda name: name == tables.TRIALS):
        with atomic_file(own / name) as file:
            file.write(brought[name].read_bytes())
    return True
