"""Messages: those of the library name no option of a command line, which its other users do not have."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
LIBRARY = sorted(
    path
    for folder in ("envs", "agents", "usbench")
    for path in (ROOT / folder).rglob("*.py")
    if "cli" not in path.relative_to(ROOT).parts
)
# Dask's own, of its workers.
FOREIGN = {"--nthreads"}
TELLING = ("tell", "warn", "warning", "info", "announce")


def told(path):
    """The texts of the errors that a module makes, and of what it tells while it works."""
    for node in ast.walk(ast.parse(path.read_text())):
        called = getattr(node, "func", None)
        name = getattr(called, "id", getattr(called, "attr", ""))
        if isinstance(node, ast.Call) and (name.endswith("Error") or name in TELLING):
            for part in ast.walk(node):
                if isinstance(part, ast.Constant) and isinstance(part.value, str):
                    yield part.value


@pytest.mark.parametrize("path", LIBRARY, ids=lambda path: str(path.relative_to(ROOT)))
def test_messages_of_the_library_name_no_option(path):
    named = {option for text in told(path) for option in re.findall(r"(?<![\w-])--[a-z][a-z-]*", text)}
    assert named <= FOREIGN
