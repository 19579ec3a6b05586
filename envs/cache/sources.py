"""The code that computed what is kept on disk: sources, versions of libraries, and the processor."""

from __future__ import annotations

import ast
import hashlib
import os
import platform
from importlib import metadata
from pathlib import Path

import llvmlite.binding

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
    """Return the source by name of the modules `first` below usbench.envs, and of what they import there."""
    found: dict[str, bytes] = {}
    waiting = list(first)
    while waiting:
        name = waiting.pop()
        if name in found:
            continue
        found[name] = _file(name).read_bytes()
        for node in ast.walk(ast.parse(found[name])):
            modules = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom):
                modules = [f"{node.module}.{alias.name}" for alias in node.names]
            waiting += [own for module in modules if (own := _own_module(module))]
    return found


def _own_module(imported: str) -> str:
    """Return the module below usbench.envs that an import names, or takes a name from; "" if none."""
    name = imported.removeprefix("usbench.envs.")
    if name == imported:
        return ""
    return name if _file(name).exists() else name.rpartition(".")[0]


def _file(name: str) -> Path:
    return Path(__file__).parents[1].joinpath(*name.split(".")).with_suffix(".py")
