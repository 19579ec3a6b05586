"""Compiled code that Numba keeps on disk is never older than what it is made of."""

import ast
from pathlib import Path

import pytest

FIELD = Path(__file__).parents[3] / "envs" / "field"


def names_in(node):
    return {part.id for part in ast.walk(node) if isinstance(part, ast.Name)}


def made_of(tree):
    """Imported names that a module's cached functions are made of, and those of what they use in turn."""
    uses, imported, queue = {}, set(), set()
    for node in tree.body:
        if isinstance(node, ast.ImportFrom) and node.module.startswith("usbench"):
            imported |= {alias.asname or alias.name for alias in node.names}
        elif isinstance(node, ast.FunctionDef):
            uses[node.name] = set().union(*map(names_in, node.body))
            if any("cache=True" in ast.unparse(decorator) for decorator in node.decorator_list):
                queue.add(node.name)
        elif isinstance(node, ast.Assign):
            for target in node.targets:
                uses.update(dict.fromkeys(names_in(target), names_in(node.value)))
    found = set()
    while queue:
        found.add(name := queue.pop())
        queue |= uses.get(name, set()) - found
    return found & imported


@pytest.mark.parametrize("path", sorted(FIELD.glob("*.py")), ids=lambda path: path.stem)
def test_compiled_functions_are_made_of_their_own_file(path):
    # Numba compiles a function again when its file has changed, and looks at no other file.
    assert not made_of(ast.parse(path.read_text()))


def test_an_imported_part_is_found():
    tree = ast.parse(
        "from usbench.envs.field.parts import part\n"
        "sums = part(2)\n"
        "@numba.njit(cache=True)\n"
        "def add(x):\n"
        "    return sums(x)\n"
    )
    assert made_of(tree) == {"part"}
