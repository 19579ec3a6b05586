"""The pages of the documentation name what exists: every link leads somewhere, every dotted name is there."""

import importlib
import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from usbench import tasks
from usbench.envs.probe import DEFAULT_ARRAY
from usbench.trials.configuration import resolve

ROOT = Path(__file__).parents[1]
PAGES = [
    *(ROOT / name for name in ("README.md", "CHANGELOG.md", "CONTRIBUTING.md", "tables/README.md")),
    *sorted((ROOT / "docs").glob("*.md")),
    *sorted((ROOT / "docs" / "environments").glob("*.md")),
]
# Columns of a code block that sites and terminals show without scrolling.
WIDEST = 78
# Leads to the repository's own page of a job, wherever the repository is.
ACTIONS = "../../actions/"
NOTEBOOKS = sorted((ROOT / "docs").glob("*.ipynb"))
BOARDS = [ROOT / "leaderboard.md", *sorted((ROOT / "tables").glob("*/leaderboard.md"))]
CARDS = sorted((ROOT / "usbench" / "trained").glob("*/card.md"))
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
    links = re.findall(r"\]\(([^)\s]+)\)|(?:src|href)=\"([^\"]+)\"", page.read_text())
    found = {one or other for one, other in links}
    files = {link.partition("#")[0] for link in found if "://" not in link and not link.startswith(ACTIONS)}
    assert [name for name in sorted(files) if not (page.parent / name).exists()] == []


def headings(page):
    """Return the places of a page that links may name, as hosting sites spell them."""
    text = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)
    found = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in found}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_link_to_a_heading_arrives(page):
    links = re.findall(r"\]\(([^)\s:]*?)#([^)\s]+)\)", page.read_text())
    assert [
        f"{name}#{place}"
        for name, place in links
        if (not name or name.endswith(".md")) and place not in headings(page.parent / name if name else page)
    ] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_dotted_name_exists(page):
    names = {*re.findall(r"\busbench(?:\.[A-Za-z_]\w*)+", page.read_text())} - GROUPS
    assert [name for name in sorted(names) if not exists(name)] == []


def test_the_reference_names_every_module_once():
    named = re.findall(r"^   (usbench[\w.]*)$", (ROOT / "docs" / "api.md").read_text(), re.MULTILINE)
    # Importing this one runs the command.
    assert sorted(named) == sorted(MODULES - {"usbench.__main__"})


def blocks(page, kind):
    """Return the code of all blocks of a kind."""
    return re.findall(rf"^```{kind}\n(.*?)^```", page.read_text(), re.DOTALL | re.MULTILINE)


@pytest.mark.parametrize(
    "page", [*PAGES, *CARDS, *BOARDS, *NOTEBOOKS], ids=lambda page: str(page.relative_to(ROOT))
)
def test_code_blocks_are_not_wider_than_what_is_shown(page):
    if page in NOTEBOOKS:
        cells = json.loads(page.read_text())["cells"]
        shown = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    else:
        shown = re.findall(r"^```[^\n]*\n(.*?)^```", page.read_text(), re.DOTALL | re.MULTILINE)
    wide = [line for block in shown for line in block.split("\n") if len(line) > WIDEST]
    assert wide == []


@pytest.mark.parametrize("page", [*PAGES, *CARDS], ids=lambda page: str(page.relative_to(ROOT)))
def test_commands_that_train_name_algorithm_and_task(page):
    shown = re.findall(r"^ *```bash\n(.*?)^ *```", page.read_text(), re.DOTALL | re.MULTILINE)
    commands = "\n".join(shown).replace("\\\n", " ").split("\n")
    trained = [line for line in commands if re.match(r"\s*usbench run ", line)]
    assert [line for line in trained if "--algo " not in line or "--task " not in line] == []


def test_the_first_hour_begins_on_the_first_60_lines_of_the_readme():
    top = "\n".join((ROOT / "README.md").read_text().split("\n")[:60])
    for part in ("docs/agent.webp", "pip install", "gym.make", "docs/environments/pp.png", "usbench guide"):
        assert part in top
    for page in ("docs/tutorial.md", "leaderboard.md", "docs/environments/index.md", "docs/extending.md"):
        assert f"({page})" in top


def test_the_readme_says_the_numbers_of_the_tables():
    words = " ".join((ROOT / "README.md").read_text().split())
    table = (ROOT / "leaderboard.md").read_text()
    together = re.findall(r"(\d\.\d\d)\*{0,2}<!-- ([\w-]+) -->", words)
    assert {agent for _, agent in together} == {"ppo", "dqn", "vpg", "vpg-tuned"}
    for said, agent in together:
        shown = re.search(rf"^\| `{agent}` \| \d+/\d+ \| (\d\.\d+) ", table, re.MULTILINE)
        # The table is rounded itself: 0.8748 is 0.875 there and 0.87 in words.
        assert shown and abs(float(shown[1]) - float(said)) <= 0.005 + 1e-9
    cells = pd.read_csv(ROOT / "scores.csv").query("table == 'grid' and actions == 'greedy'")
    single = re.findall(r"(\d\.\d\d)<!-- (\w+) (\w+) ([\d.]+) -->", words)
    for said, agent, task, noise in single:
        own = cells[(cells["agent"] == agent) & (cells["task"] == task) & (cells["noise"] == float(noise))]
        assert f"{own['score'].item():.2f}" == said
    assert single
    physics = (ROOT / "docs" / "physics.md").read_text()
    speed = re.search(r"frames per second, pose to pixels, focus 50 mm\s+[│|]\s+(\d+)", physics)
    exact = re.search(r"RF correlation, focus 50 mm, 64 lines\s+[│|]\s+(\d\.\d+)", physics)
    assert speed and f"**{speed[1]} frames per second**" in words
    assert exact and f"**{float(exact[1]):.4f}**" in words


def test_the_page_of_the_simulator_says_what_the_default_probe_is():
    page = (ROOT / "docs" / "physics.md").read_text().split("## The default probe")[1].split("\n## ")[0]
    rows = re.findall(r"^\| .* \| (`.*`) \| (.*) \|$", page, re.MULTILINE)
    units = {"": 1, "MHz": 1e6, "mm": 1e-3, "m/s": 1}
    for names, said in rows:
        expected = [
            sum(getattr(DEFAULT_ARRAY, name) for name in re.findall(r"`(\w+)`", one))
            for one in names.split(", ")
        ]
        values = [value.partition(" ") for value in said.split(", ")]
        found = [float(number) * units[unit] for number, _, unit in values]
        assert found == pytest.approx(expected, rel=1e-12), names
    assert len(rows) == 8


def test_the_page_of_failures_says_the_numbers_of_the_second_network():
    page = (ROOT / "docs" / "failures.md").read_text().split("## A second network")[1].split("\n## ")[0]
    rows = re.findall(r"^\| `([\w-]+)` \| (.*) \|$", page, re.MULTILINE)
    assert len(rows) == 8
    scores = pd.read_csv(ROOT / "scores.csv").query("actions == 'greedy' and noise == 0")
    by_cell = scores.set_index(["agent", "task", "table"])[["score", "score_low", "score_high"]]
    for agent, cells in rows:
        own = [
            by_cell.loc[(name, task, table)]
            for task in ("fp", "pp")
            for name, table in ((agent, "grid"), (f"{agent}+residual", "second-network"))
        ]
        expected = [f"{cell.iloc[0]:.2f} [{cell.iloc[1]:.2f}, {cell.iloc[2]:.2f}]" for cell in own]
        assert cells.split(" | ") == expected


def test_the_page_of_agents_says_the_numbers_of_double_dqn_on_the_papers_tasks():
    page = (ROOT / "docs" / "agents.md").read_text().split("### On the paper's tasks")[1].split("\n### ")[0]
    said = re.findall(r"^\| `(\w+)`, ([\d.]+) \| (.*) \|$", page, re.MULTILINE)
    here, grid = (
        pd.read_csv(ROOT / folder / "scores.csv").query("actions == 'greedy' and table == 'grid'")
        for folder in ("tables/double-dqn", ".")
    )
    assert len(said) == 6
    for task, noise, cells in said:
        cell = f"task == {task!r} and noise == {noise}"
        rows = grid.query(f"{cell} and agent not in ['oracle', 'random', 'stay']")
        shown = [here.query(f"{cell} and agent == 'double_dqn'").iloc[0], rows.loc[rows["score"].idxmax()]]
        own, best = (f"{row.score:.3f} [{row.score_low:.3f}, {row.score_high:.3f}]" for row in shown)
        assert cells.split(" | ") == [own, f"`{shown[1].agent}` {best}"]


def test_the_page_of_failures_says_how_often_agents_miss_the_object():
    page = (ROOT / "docs" / "failures.md").read_text().split("**Missing the object**")[1].split("\n## ")[0]
    said = [row.split(" | ")[1:] for row in re.findall(r"^  \| (.+ %) \|$", page, re.MULTILINE)]
    ends = pd.read_csv(ROOT / "docs" / "ends.csv").query("task == 'pp'")
    beside = (100 * ends.pivot(index="algo", columns="noise", values="beside")).round().astype(int)
    others = beside.drop(["vpg", "vpg-tuned", "oracle", "random", "stay"])
    assert len(others) == 6
    alone = [[f"{share} %" for share in beside.loc[name]] for name in ("vpg", "vpg-tuned", "oracle")]
    ranges = [f"{low} to {high} %" for low, high in zip(others.min(), others.max(), strict=True)]
    assert said == [*alone[:2], ranges, alone[2]]


def test_the_blocks_of_the_readme_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for block in blocks(ROOT / "README.md", "python"):
        exec(block, {})
    assert capsys.readouterr().out.startswith("(90, 40, 1) ")


def test_points_of_ones_own_are_seen(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for block in blocks(ROOT / "docs" / "points.md", "python"):
        exec(block, names)
    picture = np.asarray(Image.open("points.png"))
    # Points at depths of 20 and 30 mm, pixels of 0.1 mm, and speckle around them.
    for row, column in ((200, 120), (300, 120), (300, 170)):
        assert picture[row - 4 : row + 4, column - 4 : column + 4].max() > 200
    assert 60 < np.median(picture[60:440]) < 180


# Options of a cell stand between two lines of dashes before its code.
CELL = re.compile(
    r"^```\{code-cell\} python\n(?:---\n(?P<options>.*?)^---\n)?(?P<code>.*?)^```", re.DOTALL | re.MULTILINE
)


def cells(page):
    return [cell["code"] for cell in CELL.finditer(page.read_text())]


def test_the_gallery_has_eight_short_examples():
    _, *examples = cells(ROOT / "docs" / "gallery.md")
    assert len(examples) == 8
    assert all(len(code.strip().split("\n")) <= 15 for code in examples)


def test_pictures_that_cells_draw_have_words():
    """Without them the site has the name of a file."""
    _, *examples = CELL.finditer((ROOT / "docs" / "gallery.md").read_text())
    given = "mystnb:\n  image:\n    alt: >-\n"
    assert all(cell["options"].startswith(given) for cell in examples)
    words = [cell["options"].removeprefix(given) for cell in examples]
    for notebook in NOTEBOOKS:
        for cell in json.loads(notebook.read_text())["cells"]:
            if cell["cell_type"] == "code" and re.search(r"\bdisplay\(|\bplt\.", "".join(cell["source"])):
                words.append(cell["metadata"]["mystnb"]["image"]["alt"])
    assert len(words) == len(set(words)) == 11 and all(len(one.split()) > 7 for one in words)


@pytest.mark.slow
def test_the_gallery_runs_and_every_example_draws_something():
    import matplotlib.pyplot as plt

    plt.switch_backend("agg")
    names: dict[str, object] = {}
    for number, code in enumerate(cells(ROOT / "docs" / "gallery.md")):
        exec(code, names)
        assert bool(plt.get_fignums()) == (number > 0)
        plt.close("all")


def test_formulas_of_the_simulator_can_be_drawn_as_mathml():
    convert = pytest.importorskip("latex2mathml.converter").convert
    page = re.sub(
        r"^```.*?^```", "", (ROOT / "docs" / "physics.md").read_text(), flags=re.DOTALL | re.MULTILINE
    )
    on_lines = re.findall(r"^\$\$\n(.*?)\n\$\$", page, re.DOTALL | re.MULTILINE)
    within_lines = re.findall(r"(?<!\$)\$([^$\n]+)\$(?!\$)", page)
    assert len(on_lines) == 11 and len(within_lines) > 50
    assert all(convert(formula).startswith("<math") for formula in [*on_lines, *within_lines])


def test_every_trained_agent_has_its_card_on_the_site_and_a_link_to_it():
    shown = (ROOT / "docs" / "cards.md").read_text()
    linked = (ROOT / "docs" / "agents.md").read_text()
    for card in CARDS:
        place = card.relative_to(ROOT).as_posix()
        assert f"```{{include}} ../{place}\n" in shown and f"(../{place})" in linked


def test_trial_folders_that_pages_and_help_name_are_those_of_today():
    """Settings of a row may change; then the same command makes a trial of another name."""
    texts = [*PAGES, *sorted((ROOT / "usbench" / "cli").rglob("*.py"))]
    named = {
        (*found.groups(), path.name)
        for path in texts
        for found in re.finditer(
            r"runs/(([a-z-]+)-p0-(\w+)-s(\d+)-[0-9a-f]{8})", path.read_text(encoding="utf-8")
        )
    }
    assert {"tutorial.md", "watch.py"} <= {name for *_, name in named}
    for folder, task, algo, seed, _ in named:
        # The whole budget, and that of the tutorial.
        trials = [resolve(algo, task, seed=int(seed), steps=steps) for steps in (None, 2048)]
        assert folder in [trial.folder_name for trial in trials]
