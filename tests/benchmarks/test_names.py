"""What the scripts in benchmarks/ use of the package is there: most of them take too long to be run here."""

import ast
import importlib
import types
from pathlib import Path

import pytest

SCRIPTS = [
    path
    for path in sorted(Path(__file__).parents[2].glob("benchmarks/**/*.py"))
    if "from usbench" in path.read_text(encoding="utf-8")
]


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.name)
def test_a_script_uses_names_that_are_there(script):
    nodes = list(ast.walk(ast.parse(script.read_text(encoding="utf-8"))))
    modules = {}
    for node in nodes:
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("usbench"):
            for name in node.names:
                found = getattr(importlib.import_module(node.module), name.name, None)
                if found is None:
                    found = importlib.import_module(f"{node.module}.{name.name}")
                if isinstance(found, types.ModuleType):
                    modules[name.asname or name.name] = found
    for node in nodes:
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in modules:
            assert hasattr(modules[node.value.id], node.attr), f"line {node.lineno}: {ast.unparse(node)}"
