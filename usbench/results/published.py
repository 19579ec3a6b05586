"""The tables of the committed leaderboard come with the package: to add to them, nobody needs a clone."""

from importlib import resources
from pathlib import Path

from usbench.atomic import atomic_file
from usbench.results import additions, tables

# What stands for their folder where a folder of trials or of tables is named.
NAME = "published"


def folder() -> Path:
    """Return the folder of the tables that come with the package."""
    return Path(str(resources.files("usbench.published").joinpath(tables.TRIALS))).parent


def or_own(own: Path) -> Path:
    """Return the folder `own` if it holds tables, else that of the tables that come with the package."""
    return own if (own / tables.TRIALS).exists() else folder()


def bring(own: Path) -> bool:
    """Copy the tables that come with the package into the folder `own`, if it holds none; return whether.

    The names of those trials that are not verified come with them.
    """
    if (own / tables.TRIALS).exists():
        return False
    brought = {path.name: path for path in (*folder().glob("*.csv"), *folder().glob(additions.UNVERIFIED))}
    # Last what says that all are there.
    for name in sorted(brought, key=lambda name: name == tables.TRIALS):
        with atomic_file(own / name) as file:
            file.write(brought[name].read_bytes())
    return True
