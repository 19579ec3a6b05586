"""The page of a set of trials: complete, closed to the outside, the same bytes again."""

import base64
import collections
import io
import re
import shutil
from html.parser import HTMLParser
from xml.etree import ElementTree

import markupsafe
import pytest
from PIL import Image
from state_files import read_state, write_state

from usbench import cli, records
from usbench.envs import guidance
from usbench.envs.bmode import Imaging
from usbench.envs.probe import LinearArray
from usbench.records import ConfigurationError
from usbench.report import page, text
from usbench.trials import runner
from usbench.trials.configuration import resolve

SECTIONS = {
    "leaderboard", "learning", "comparison", "paper", "agents", "look-alikes", "endings", "configuration",
}  # fmt: skip
VOID = {"meta", "img", "input"}


class Page(HTMLParser):
    """What a page is made of; refuses tags that do not close as they opened."""

    def __init__(self, text):
        super().__init__()
        self.elements, self._open = [], []
        self.feed(text)
        self.close()
        assert self._open == []

    def handle_starttag(self, tag, attributes):
        self.elements.append((tag, dict(attributes)))
        if tag not in VOID:
            self._open.append(tag)

    def handle_endtag(self, tag):
        assert self._open.pop() == tag

    def all(self, name):
        return [attributes for tag, attributes in self.elements if tag == name]


@pytest.fixture
def runs(finished, monkeypatch):
    """A folder with a finished trial (vpg on pp), and frames drawn instead of simulated."""
    monkeypatch.setattr("usbench.report.poses.frame_store", guidance.frame_store)
    return finished.parent


@pytest.fixture
def without_figures(monkeypatch):
    """Leave out what takes most of the time, where it is not what is looked at."""
    monkeypatch.setattr("usbench.figures.comparison.draw", lambda known: {})
    monkeypatch.setattr("usbench.report.poses.overview", lambda known: None)


def made(runs, out):
    return page.write(runs, out / "report.html").read_text()


def add(runs, name, **changes):
    """Copy the trial's record to another seed of another status."""
    (trial,) = records.trial_folders(runs)
    state = read_state(trial) | changes
    state["config"]["seed"] = 1
    (runs / name).mkdir()
    write_state(runs / name, state)


def test_page_is_whole_and_closed_to_the_outside(runs, tmp_path):
    text = made(runs, tmp_path)
    page = Page(text)
    assert {attributes.get("id") for attributes in page.all("section")} == SECTIONS
    assert len(page.all("h1")) == 1
    links = [attributes["href"] for attributes in page.all("a")]
    assert {link.removeprefix("#") for link in links} == {*SECTIONS, "main"}
    assert not {"script", "link", "iframe", "object", "form"} & {tag for tag, _ in page.elements}
    assert not re.search(r"""(src|href|url)\s*[=(]\s*["']?\s*(https?:)?//""", text)
    for image in page.all("img"):
        assert image["src"].startswith("data:image/") and len(image["alt"]) > 20
        kind, _, data = image["src"].partition(";base64,")
        content = base64.b64decode(data)
        if kind == "data:image/svg+xml":
            assert ElementTree.fromstring(content).tag.endswith("svg")
        else:
            with Image.open(io.BytesIO(content)) as opened:
                opened.load()
    assert len(page.all("caption")) == len(page.all("table")) > 5
    ids = [attributes["id"] for _, attributes in page.elements if "id" in attributes]
    assert len(ids) == len(set(ids))
    for words in (
        "A first look and no ranking: training was cut short",
        "The only trial is finished",
        "Dotted: the ceiling of what agents are told",
        "return that it costs",
        "out of the object&#39;s plane",
        "value_learning_rate 0.001",
        "center_frequency</th><td>3.5e+06",
        "numpy 2",
    ):
        assert words in text, words


def test_same_records_give_the_same_bytes_wherever_they_are(runs, tmp_path):
    shutil.copytree(runs, tmp_path / "elsewhere")
    (trial,) = records.trial_folders(tmp_path / "elsewhere")
    # Once as a folder of trials, once as a trial itself.
    assert made(runs, tmp_path) == made(trial, tmp_path)


@pytest.mark.parametrize("beside_the_grid", [False, True])
def test_a_further_table_has_its_sections_and_figures(runs, trial_on, tmp_path, beside_the_grid):
    trial = trial_on("pp-tracked")
    if beside_the_grid:
        trial = shutil.copytree(trial, runs / trial.name).parent
    text = made(trial, tmp_path)
    Page(text)
    headings = re.findall("<h3>(.*?)</h3>", text)
    assert "Probe plane, new phantoms, tracked probe, noise 0.25: unseen-phantoms" in headings
    assert ("Probe plane, noise 0.5" in headings) == beside_the_grid
    assert ("Further table: unseen-phantoms" in headings) == beside_the_grid
    captions = re.findall("<figcaption>(.*?)</figcaption>", text)
    of_table = "Further table unseen-phantoms: Normalised score of every agent"
    assert any(caption.startswith(of_table) for caption in captions) == beside_the_grid
    assert any(caption.startswith("Normalised score of every agent") for caption in captions)


def test_every_part_of_the_leaderboard_is_in_the_page(runs, without_figures, tmp_path, monkeypatch):
    parts = {name: markupsafe.Markup(f"<p>{name}</p>") for name in ("Stability of ranks", "pp together")}
    monkeypatch.setattr(text, "sections", lambda *_: collections.defaultdict(markupsafe.Markup, parts))
    page = made(runs, tmp_path)
    assert all(f"<h3>{name}</h3>\n<p>{name}</p>" in page for name in parts)


def test_without_weights_there_is_a_sentence_instead_of_a_map(runs, without_figures, tmp_path):
    (trial,) = records.trial_folders(runs)
    (trial / records.MODEL).unlink()
    text = made(runs, tmp_path)
    assert f"No map of its actions: {trial.name} has no weights." in text
    assert "Replay, moving." in text and "return that it costs" not in text


def test_weights_that_cannot_be_opened_are_told_without_the_place(runs, without_figures, tmp_path):
    (trial,) = records.trial_folders(runs)
    (trial / records.MODEL).write_bytes(b"no archive")
    text = made(runs, tmp_path)
    assert "No map of its actions:" in text and str(tmp_path) not in text


def test_a_trial_with_another_probe_and_imaging_is_replayed_without_a_map(
    quick, monkeypatch, without_figures, tmp_path
):
    monkeypatch.setattr("usbench.report.poses.frame_store", guidance.frame_store)
    imaging = Imaging(height_px=128, width_px=128)
    config = resolve("vpg", "pp", steps=64, probe=LinearArray(n_lines=96), imaging=imaging)
    runner.run_trial(config, tmp_path / "runs")
    content = made(tmp_path / "runs", tmp_path)
    assert "Replay, moving." in content
    assert "No map of its actions: maps are made for the task&#39;s own probe and imaging" in content
    assert "width_px</th><td>128" in content
    assert f"not their task's: 1 of 1, as <code>{config.folder_name}</code>." in content
    assert "usbench compare --algos" not in content


def test_trials_that_are_not_finished_are_named_and_strangers_words_are_only_words(
    runs, without_figures, tmp_path
):
    reason = 'OSError <script>alert("x")</script> ![x](https://example.org/x.png)'
    add(runs, "failed", status="failed", reason=reason)
    text = made(runs, tmp_path)
    assert "1 of 2 trials are finished" in text
    assert "seed 1 failed (OSError &lt;script&gt;" in text
    assert "<script" not in text and 'src="https' not in text


def test_the_report_of_one_trial_is_about_that_trial_alone(runs, without_figures, tmp_path, capsys):
    (trial,) = records.trial_folders(runs)
    shutil.copytree(trial, runs / "copy")
    (runs / "broken").mkdir()
    (runs / "broken" / records.TRIAL).write_text("[]")
    (runs / "study-anna").mkdir()
    (runs / "study-anna" / "study.json").write_text("{}")
    out = tmp_path / "page.html"
    assert cli.main(["report", str(trial), "--out", str(out)]) == 0
    assert "left out" not in capsys.readouterr().err
    page = out.read_text()
    assert "report of 1 trial</title>" in page and 'id="people"' not in page


def test_nothing_finished_is_said(runs, without_figures, tmp_path):
    (trial,) = records.trial_folders(runs)
    add(runs, "running", status="running")
    shutil.rmtree(trial)
    text = made(runs, tmp_path)
    Page(text)
    assert "0 of 1 trials are finished" in text and "seed 1 is running or was killed" in text
    assert "No trial is finished yet." in text and "<img" not in text


@pytest.mark.parametrize(
    ("runs", "out", "said"),
    [
        ("missing", "report.html", "no folder"),
        ("afile.txt", "report.html", "afile.txt' is a file, not a folder with trials"),
        ("empty", "report.html", "holds no trials"),
        ("begun", "report.html", "has begun"),
        ("broken", "report.html", "is not a trial record"),
        ("begun", "report.pdf", ".html"),
        ("begun", "missing/report.html", "folder that exists"),
    ],
)
def test_refusals(tmp_path, runs, out, said):
    (tmp_path / "afile.txt").touch()
    for name, content in (("empty", None), ("begun", "{}"), ("broken", "[]")):
        (tmp_path / name / "trial").mkdir(parents=True)
        if content:
            (tmp_path / name / "trial" / records.TRIAL).write_text(content)
    with pytest.raises(ConfigurationError, match=said) as refused:
        page.write(tmp_path / runs, tmp_path / out)
    assert "\n" not in str(refused.value)
    assert not (tmp_path / out).exists()


@pytest.mark.parametrize("file", [records.TRIAL, records.EVALUATIONS])
def test_a_damaged_trial_is_left_out_and_named(runs, without_figures, tmp_path, capsys, file):
    add(runs, "second", status="finished")
    for name in (records.EPISODES, records.EVALUATIONS):
        shutil.copy(records.trial_folders(runs)[0] / name, runs / "second")
    with (runs / "second" / file).open("r+") as damaged:
        damaged.truncate(200)
    out = tmp_path / "page.html"
    assert cli.main(["report", str(runs), "--out", str(out)]) == 0
    told = f"left out: {runs.resolve()}/second/{file} is "
    assert told in capsys.readouterr().err
    page = out.read_text()
    assert (
        "Left out, since their records are damaged or missing: second/" in page
        and "The only trial is finished." in page
    )
    assert cli.main(["plot", str(runs), "--out", str(tmp_path / "figures")]) == 0
    assert told in capsys.readouterr().err


def test_a_trial_without_its_record_is_left_out_and_named(runs, without_figures, tmp_path, capsys):
    shutil.copytree(records.trial_folders(runs)[0], runs / "second")
    (runs / "second" / records.TRIAL).unlink()
    (runs / "drawings").mkdir()
    out = tmp_path / "page.html"
    told = f"left out: {runs.resolve()}/second has no trial.json."
    for command in (["report", str(runs), "--out", str(out)], ["plot", str(runs), "--out", str(tmp_path)]):
        assert cli.main(command) == 0
        assert [line for line in capsys.readouterr().err.splitlines() if "left out" in line] == [told]
    assert "damaged or missing: second has no trial.json." in out.read_text()


def test_command_writes_the_page_and_tells_what_it_does(runs, without_figures, tmp_path, capsys):
    out = tmp_path / "page.html"
    assert cli.main(["report", str(runs), "--out", str(out)]) == 0
    captured = capsys.readouterr()
    assert captured.out.startswith(f"{out}: 0.") and captured.out.endswith(" MB\n")
    assert "agent 1 of 1: vpg on pp" in captured.err
    assert cli.main(["report", str(tmp_path / "missing")]) == 2


def test_markdown_becomes_tables_with_caption_and_headers():
    html = text.html("| agent | score |\n| --- | ---: |\n| `vpg` | **0.5** |", "All & more")
    assert 'aria-label="All &amp; more"' in html and "<span>All &amp; more</span></caption>" in html
    assert '<th scope="col">agent</th>' in html
    assert '<th scope="row"><code>vpg</code></th>' in html
    assert "<td" in html and "<strong>0.5</strong></td>" in html


def test_markdown_leads_nowhere():
    markdown = "[a](https://example.org) ![b](https://example.org/b.png) <img src=x> <https://example.org>"
    assert not re.search("<(a|img)", text.html(markdown))
