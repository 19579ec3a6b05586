"""Probe and imaging as TOML files: read and checked, and written with their defaults to start from."""

import inspect
import re
import tomllib
from dataclasses import fields
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

from usbench.checks import unknown
from usbench.envs.bmode import Imaging
from usbench.envs.probe import LinearArray
from usbench.records import ConfigurationError

Part = TypeVar("Part", LinearArray, Imaging)
# What a file can hold, by the name that it goes by.
KINDS = MappingProxyType({"probe": LinearArray, "imaging": Imaging})
# An entry of a docstring's list of attributes: name, then text that may go on over further lines.
_ATTRIBUTE = re.compile(r"^    (\w+): (.+(?:\n        .+)*)", re.MULTILINE)


def read_probe(path: Path) -> LinearArray:
    """Return the array in a TOML file; fields that the file does not name have their defaults.

    Raises:
        ConfigurationError: If the file cannot be read or a field is not allowed; one sentence says which.
    """
    return _read(LinearArray, "probe", path)


def read_imaging(path: Path) -> Imaging:
    """Return the imaging in a TOML file; else as `read_probe`."""
    return _read(Imaging, "imaging", path)


def defaults(kind: str) -> str:
    """Return the text of a file with every field of "probe" or "imaging", explained, at its default.

    Raises:
        ConfigurationError: If `kind` is neither.
    """
    if kind not in KINDS:
        raise ConfigurationError(str(unknown("part of a setting", kind, KINDS)))
    part = KINDS[kind]()
    words = {name: " ".join(text.split()) for name, text in _ATTRIBUTE.findall(inspect.getdoc(part) or "")}
    entries = [
        f"# {words[field.name]}\n{field.name} = {getattr(part, field.name)!r}" for field in fields(part)
    ]
    return "\n\n".join(entries) + "\n"


def _read(cls: type[Part], kind: str, path: Path) -> Part:
    try:
        values: dict[str, Any] = tomllib.loads(path.read_text(encoding="utf-8"))
        names = [field.name for field in fields(cls)]
        for name in values:
            if name not in names:
                raise unknown(f"field of the {kind} file", name, names)
        return cls(**values)
    except OSError as error:
        raise ConfigurationError(
            f"the {kind} file {str(path)!r} cannot be read ({error.strerror})."
        ) from error
    except (TypeError, ValueError) as error:
        raise ConfigurationError(f"the {kind} file {str(path)!r} cannot be used: {error}") from error
