"""The pages of the documentation name what exists: every link leads somewhere, every dotted name is there."""

import importlib
import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

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


def test_the_blocks_of_the_readme_run_and_its_points_are_seen(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for block in re.findall(
        r"^```python\n(.*?)^```", (ROOT / "README.md").read_text(), re.DOTALL | re.MULTILINE
    ):
        exec(block, names)
        if "points.png" in block:
            assert len(block.split("\n")) == 14  # twelve lines, a blank one, and the end
            picture = np.asarray(Image.open("points.png"))
            # Points at depths of 20 and 30 mm, pixels of 0.1 mm, and speckle around them.
            for row, column in ((200, 120), (300, 120), (300, 170)):
                assert picture[row - 4 : row + 4, column - 4 : column + 4].max() > 200
            assert 60 < np.median(picture[60:440]) < 180


def cells(page):
    return re.findall(r"^```\{code-cell\} python\n(.*?)^```", page.read_text(), re.DOTALL | re.MULTILINE)


def test_the_gallery_has_eight_short_examples():
    _, *examples = cells(ROOT / "docs" / "gallery.md")
    assert len(examples) == 8
    assert all(len(code.strip().split("\n")) <= 15 for code in examples)


@pytest.mark.slow
def test_the_gallery_runs_and_every_example_draws_something():
    import matplotlib.pyplot as plt

    plt.switch_backend("agg")
    names: dict[str, object] = {}
    for number, code in enumerate(cells(ROOT / "docs" / "gallery.md")):
        exec(code, names)
        assert bool(plt.get_fignums()) == (number > 0)
        plt.close("all")
