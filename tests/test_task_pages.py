"""The pages of the tasks are what `make task-pages` writes from the code."""

import ast
import re
import runpy
from pathlib import Path

import pytest
from markdown_it import MarkdownIt
from PIL import Image

from usbench import suite
from usbench.anchors import Anchors
from usbench.setting import Setting

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "docs" / "environments"
WRITER = runpy.run_path(str(ROOT / "benchmarks" / "task_pages.py"))
QUICK = ("fp", "pp", "pp-random", "pp-tracked", "fp-random", "exam", "exam-stop")


def shown(task):
    """Return the anchors that the page of a task shows."""
    page = (FOLDER / f"{task}.md").read_text()
    found = [
        re.search(rf"return of the {name}, noise 0 \| (-?[\d.]+) ", page)
        for name in ("optimum", "random agent", "idle agent")
    ]
    return Anchors(*(float(one[1]) for one in found))


@pytest.mark.parametrize("task", suite.TASKS)
def test_a_page_is_what_the_code_says(task):
    assert (FOLDER / f"{task}.md").read_text() == WRITER["text"](task, shown(task))


@pytest.mark.parametrize(
    "task", [task if task in QUICK else pytest.param(task, marks=pytest.mark.slow) for task in suite.TASKS]
)
def test_its_anchors_are_exact(task):
    setting = Setting(task=task)
    anchors, own = shown(task), setting.anchors()
    # On another kind of processor some pixels differ by a grey level, and with them rewards from frames.
    exact = 1e-3 if setting.guidance.reward_from_frames else 5e-5
    for name in ("optimal", "random", "stay"):
        assert getattr(anchors, name) == pytest.approx(getattr(own, name), abs=exact)


@pytest.mark.parametrize("task", suite.TASKS)
def test_an_environment_takes_the_arguments_of_its_page_and_is_the_task_by_their_defaults(task):
    (line,) = re.findall(r"^\| arguments \| (.+) \|$", (FOLDER / f"{task}.md").read_text(), re.MULTILINE)
    shown = {
        name: ast.literal_eval(value)
        for name, value in (one.split("=", 1) for one in re.findall(r"`([^`]+)`", line))
    }
    setting = Setting(task=task)
    assert shown["senses"] == setting.senses
    assert ("phantom" in shown, "phantoms" in shown) == (not setting.row.phantoms, setting.row.phantoms > 0)
    own, plain = type(setting.plain_env())(**shown), setting.plain_env()
    for name in (*plain.scene, "noise", "reward", "observation_space"):
        assert getattr(own, name) == getattr(plain, name), name


def test_the_gallery_has_every_task():
    assert (FOLDER / "index.md").read_text() == WRITER["gallery"]()


def test_the_gallery_has_three_tasks_in_a_row():
    page = MarkdownIt().enable("table").render((FOLDER / "index.md").read_text())
    rows = [re.findall(r'<td><a href="([^"]+)\.md"><img', row) for row in page.split("<tr>")[2:]]
    assert [task for row in rows for task in row] == list(suite.TASKS)
    assert {len(row) for row in rows[:-1]} == {3} and 1 <= len(rows[-1]) <= 3


@pytest.mark.parametrize("task", suite.TASKS)
def test_every_task_has_a_moving_picture_and_a_still(task):
    with Image.open(FOLDER / f"{task}.webp") as film:
        assert film.n_frames >= 5 and film.width == WRITER["WIDTH"]
    with Image.open(FOLDER / f"{task}.png") as still:
        assert WRITER["STILL_WIDTH"] - 5 < still.width <= WRITER["STILL_WIDTH"]
