"""Probe and imaging as TOML files: read and checked, written to start from; probes that come with usbench."""

import inspect
import re
import tomllib
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from dataclasses import fields
from importlib.resources import files
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

from usbench.checks import did_you_mean, unknown
from usbench.envs.bmode import Imaging
from usbench.envs.probe import LinearArray
from usbench.records import ConfigurationError

Part = TypeVar("Part", LinearArray, Imaging)
# What a file can hold, by the name that it goes by.
KINDS = MappingProxyType({"probe": LinearArray, "imaging": Imaging})
# An entry of a docstring's list of attributes: name, then text that may go on over further lines.
_ATTRIBUTE = re.compile(r"^    (\w+): (.+(?:\n        .+)*)", re.MULTILINE)


def presets() -> dict[str, str]:
    """Return the names of the probes that come with usbench, and what each is in one line."""
    return {name: text.partition("\n")[0].removeprefix("# ") for name, text in _preset_texts().items()}


def read_probe(name: str | Path) -> LinearArray:
    """Return a probe that comes with usbench, or the one in a TOML file.

    Args:
        name: One of `presets`, in capitals or not, or a file; fields that are not named have their defaults.

    Raises:
        ConfigurationError: If there is no such probe, or a field is not allowed; one sentence says which.
    """
    texts, preset = _preset_texts(), str(name).lower()
    return _read(LinearArray, "probe", Path(name), texts.get(preset))


def preset_of(probe: LinearArray) -> str | None:
    """Return the name of the probe that comes with usbench and equals `probe`, None where none does."""
    return next((name for name in _preset_texts() if read_probe(name) == probe), None)


def read_imaging(path: Path) -> Imaging:
    """Return the imaging in a TOML file; fields that the file does not name have their defaults.

    Raises:
        ConfigurationError: If the file cannot be read or a field is not allowed; one sentence says which.
    """
    return _read(Imaging, "imaging", path)


def defaults(kind: str) -> str:
    """Return the text of a file with every field of "probe" or "imaging", explained, or that of a preset.

    A field that has no value by default is a comment, as TOML has no word for nothing.

    Raises:
        ConfigurationError: If `kind` is none of them.
    """
    texts = _preset_texts()
    if kind.lower() in texts:
        return texts[kind.lower()]
    if kind not in KINDS:
        raise ConfigurationError(str(unknown("part of a setting", kind, [*KINDS, *texts])))
    part = KINDS[kind]()
    words = {name: " ".join(text.split()) for name, text in _ATTRIBUTE.findall(inspect.getdoc(part) or "")}
    entries = [
        f"# {words[field.name]}\n" + _entry(field.name, getattr(part, field.name)) for field in fields(part)
    ]
    return "\n\n".join(entries) + "\n"


def _entry(name: str, value: Any) -> str:
    return f"# {name} =" if value is None else f"{name} = {value!r}"


def _preset_texts() -> dict[str, str]:
    """Return the files of the presets by name."""
    folder = files("usbench") / "probes"
    found = sorted(folder.iterdir(), key=lambda file: file.name)
    return {file.name.removesuffix(".toml"): file.read_text(encoding="utf-8") for file in found}


def _read(cls: type[Part], kind: str, path: Path, text: str | None = None) -> Part:
    """Return the part that the file at `path` describes, or `text` where it is given."""
    try:
        values: dict[str, Any] = tomllib.loads(_text(path) if text is None else text)
        names = [field.name for field in fields(cls)]
        for name in values:
            if name not in names:
                raise unknown(f"field of the {kind} file", name, names)
        return cls(**values)
    except OSError as error:
        raise ConfigurationError(
            f"the {kind} file {str(path)!r} cannot be read ({error.strerror}){_known(kind, path)}."
        ) from error
    except (TypeError, ValueError) as error:
        raise ConfigurationError(f"the {kind} file {str(path)!r} cannot be used: {error}") from error


def _text(path: Path) -> str:
    """Return the text of a file in UTF-8, or in UTF-16, as Windows may write it; ValueError if in neither."""
    data = path.read_bytes()
    try:
        return data.decode("utf-16" if data.startswith((BOM_UTF16_LE, BOM_UTF16_BE)) else "utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError("it must be text in UTF-8.") from error


def _known(kind: str, path: Path) -> str:
    """Return which presets there are, where a name that is none of them was probably meant as one."""
    if kind != "probe" or path.suffix == ".toml":
        return ""
    names = presets()
    return f"; probes that need no file are {', '.join(names)}{did_you_mean(path, names)}"
