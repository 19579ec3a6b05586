"""What runs with one of the supported Pythons and not with another, found without the other."""

import symtable
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SOURCES = [
    path for folder in ("usbench", "envs", "agents", "benchmarks") for path in (ROOT / folder).rglob("*.py")
]
INLINED = {"listcomp", "setcomp", "dictcomp"}
HIDDEN = """
def name(one): return one
def names(found):
    longest = {name: len(name) for name in found}
    return [name(one) for one in longest]
"""


pytestmark = pytest.mark.skipif(sys.version_info >= (3, 12), reason="there, the functions' own tests find it")


def comprehensions(table):
    for inner in table.get_children():
        if inner.get_name() in INLINED:
            yield inner
            yield from comprehensions(inner)


def hidden(source):
    """Names of the module that a function's comprehension reads and another one of it binds.

    From Python 3.12 on both are parts of the function, and the name is then a local one without a value.
    """
    found, tables = set(), [symtable.symtable(source, "source", "exec")]
    while tables:
        table = tables.pop()
        tables += table.get_children()
        if table.get_type() == "function" and table.get_name() not in INLINED:
            names = [one for inner in comprehensions(table) for one in inner.get_symbols()]
            bound = {one.get_name() for one in names if one.is_local()}
            read = {one.get_name() for one in names if one.is_global()}
            found |= (bound & read) - set(table.get_identifiers())
    return found


def test_a_hidden_name_is_found():
    assert hidden(HIDDEN) == {"name"}


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_no_comprehension_hides_a_name_from_another(path):
    assert hidden(path.read_text()) == set()
