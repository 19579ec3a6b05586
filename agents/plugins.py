"""Algorithms from outside the package: named "module:name", or by an entry point."""

import importlib
import re
from collections.abc import Collection
from importlib.metadata import entry_points

from usbench.checks import ConfigurationError
from usbench.words import in_one_line

GROUP = "usbench.algorithms"
_PLACE = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*")


def registered(taken: Collection[str] = ()) -> dict[str, str]:
    """The entry points of installed packages: name of an algorithm -> "module:name".

    Raises:
        ConfigurationError: a package brings a name that another one brings, or that is `taken`.
    """
    found: dict[str, str] = {}
    for point in entry_points(group=GROUP):
        if point.name in found or point.name in taken:
            origin = f"the package {point.dist.name!r}" if point.dist else f"a package with {point.value!r}"
            raise ConfigurationError(
                f"{origin} brings an algorithm {point.name!r}, which exists already: uninstall one of them."
            )
        found[point.name] = point.value
    return found


def load(place: str) -> object:
    """What stands at `place`, "module:name".

    Raises:
        ValueError: `place` has another form, or the module cannot be imported, or has no such name.
    """
    module, _, name = place.partition(":")
    if not _PLACE.fullmatch(place) or module.endswith(".py"):
        raise ValueError(
            "an algorithm outside this package is named module:name, as mine:Counter in mine.py, "
            f"not {place!r}."
        )
    try:
        return getattr(importlib.import_module(module), name)
    except (Exception, SystemExit) as error:  # whatever a stranger's module does while it is imported
        reason = in_one_line(error, with_type=True)
        raise ValueError(f"the algorithm {place!r} cannot be imported ({reason}).") from error
