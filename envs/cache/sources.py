"""The code that computed what is kept on disk: sources, versions of libraries, and the processor."""

from __future__ import annotations

import ast
import hashlib
import os
import platform
from dataclasses import fields, is_dataclass
from functools import lru_cache
from importlib import metadata
from pathlib import Path

import llvmlite.binding

from usbench import words

LIBRARIES = ("numpy", "scipy", "numba", "llvmlite", "opencv-python-headless")


def code_hash(*first: str) -> str:
    """Return a hash of the modules `first` and what they import, the libraries, and the processor.

    The processor is the one that Numba compiles for, which its environment variables may set.
    """
    versions = [f"{name} {metadata.version(name)}" for name in LIBRARIES]
    name = os.environ.get("NUMBA_CPU_NAME") or llvmlite.binding.get_host_cpu_name()
    features = os.environ.get("NUMBA_CPU_FEATURES")
    processor = (platform.machine(), name, *(() if features is None else (features,)))
    return hash_of((sorted(sources(*first).items()), versions, processor))


def hash_of(value: object) -> str:
    """Return a hash of what `repr` says of `value`."""
    return hashlib.sha256(repr(value).encode()).hexdigest()


def sources(*first: str) -> dict[str, bytes]:
    """Return the source by name of the modules `first` below usbench.envs, and of what they import of ours.

    Modules below usbench.envs have their names there ("scanner"), others their whole names ("usbench.words").
    """
    found: dict[str, bytes] = {}
    waiting = list(first)
    while waiting:
        name = waiting.pop()
        if name in found:
            continue
        found[name] = _file(name).read_bytes()
        waiting += [own for module in _imported(found[name]) if (own := _own_module(module))]
    return found


def is_own(value: object) -> bool:
    """Return whether the classes of `value` and of all that it holds are of this package.

    The code of others, also of classes derived from ours, is in no hash: what depends on it is not kept.
    """
    module = type(value).__module__
    if isinstance(value, tuple | list):
        return all(map(is_own, value))
    if module in ("builtins", "numpy"):
        return True
    held = [getattr(value, field.name) for field in fields(value)] if is_dataclass(value) else []
    return module.startswith("usbench.") and all(map(is_own, held))


@lru_cache(maxsize=256)
def _imported(source: bytes) -> tuple[str, ...]:
    """Return the names of all that a source imports, of modules or of what is in them."""
    found: list[str] = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        if isinstance(node, ast.ImportFrom):
            found += [f"{node.module}.{alias.name}" for alias in node.names]
    return tuple(found)


def _own_module(imported: str) -> str:
    """Return the module of usbench that an import names, or takes a name from; "" if none."""
    if not imported.startswith("usbench."):
        return ""
    name = imported.removeprefix("usbench.envs.")
    names = (name, name.rpartition(".")[0])
    return next((one for one in names if one and _file(one).exists()), "")


def _file(name: str) -> Path:
    own = name.removeprefix("usbench.")
    top = Path(__file__).parents[1] if own == name else Path(words.__file__).parent
    return top.joinpath(*own.split(".")).with_suffix(".py")
