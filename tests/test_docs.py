"""The pages of the documentation name what exists: every link leads somewhere, every dotted name is there."""

import importlib
import re
from pathlib import Path

import pytest

from usbench import tasks

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").glob("*.md"))]
PACKAGES = {"usbench": "usbench", "usbench.envs": "envs", "usbench.agents": "agents"}
# Names of groups of entry points, which look like modules.
GROUPS = {"usbench.algorithms", tasks.GROUP}


def modules():
    """Return the names of all modules of the three folders, packages among them."""
    paths = {
        (package, path.relative_to(ROOT / folder).with_suffix(""))
        for package, folder in PACKAGES.items()
        for path in (ROOT / folder).rglob("*.py")
    }
    return {".".join((package, *path.parts)).removesuffix(".__init__") for package, path in paths}


def exists(name):
    """Say whether a dotted name is a module, or an attribute of one."""
    if name in MODULES:
        return True
    parent, _, last = name.rpartition(".")
    return parent in MODULES and hasattr(importlib.import_module(parent), last)


MODULES = modules()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_relative_link_leads_to_a_file(page):
    links = re.findall(r"\]\(([^)\s]+)\)", page.read_text())
    files = {link.partition("#")[0] for link in links if "://" not in link}
    assert [name for name in sorted(files) if not (page.parent / name).exists()] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_dotted_name_exists(page):
    names = {*re.findall(r"\busbench(?:\.[A-Za-z_]\w*)+", page.read_text())} - GROUPS
    assert [name for name in sorted(names) if not exists(name)] == []


def test_the_reference_names_every_module_once():
    named = re.findall(r"^   (usbench[\w.]*)$", (ROOT / "docs" / "api.md").read_text(), re.MULTILINE)
    # Importing this one runs the command.
    assert sorted(named) == sorted(MODULES - {"usbench.__main__"})
