"""The page in a real Chromium, offline: complete, not too wide, still if that is wished, accessible."""

import os
import shutil

import pytest
from quick_trials import speed_up

from usbench.envs import guidance
from usbench.report import page as report

sync_api = pytest.importorskip("playwright.sync_api")
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium")
PATIENCE_MS = 60_000
WIDE = "[document.documentElement.scrollWidth, document.documentElement.clientWidth]"
EMPTY = "[...document.images].filter(one => !one.complete || !one.naturalWidth).length"
UNFOLD = "document.querySelectorAll('details').forEach(one => { one.open = true; })"


@pytest.fixture(scope="module")
def written(_trial, trial_on, tmp_path_factory):
    """The report of trials on both of the paper's tasks."""
    folder = tmp_path_factory.mktemp("report")
    with pytest.MonkeyPatch.context() as monkeypatch:
        speed_up(monkeypatch)
        monkeypatch.setattr("usbench.report.poses.frame_store", guidance.frame_store)
        for trial in (_trial, trial_on("fp")):
            shutil.copytree(trial, folder / "runs" / trial.name)
        yield report.write(folder / "runs", folder / "report.html")


@pytest.fixture(scope="module")
def browser():
    arguments = ["--disable-gpu", *(["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else [])]
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=arguments)
        yield browser
        browser.close()


@pytest.fixture
def page(browser, written):
    """The page without a network; checks at the end that it asked for nothing and met no problem."""
    problems = []
    with browser.new_context(offline=True, viewport={"width": 360, "height": 780}) as context:
        page = context.new_page()
        page.set_default_timeout(PATIENCE_MS)
        page.on("console", lambda message: problems.append(message.text))
        page.on("pageerror", lambda error: problems.append(str(error)))
        page.on("requestfailed", lambda request: problems.append(request.url[:100]))
        page.goto(written.as_uri())
        yield page
    assert problems == []


def shown(page, kind):
    return [image.is_visible() for image in page.locator(f"img.{kind}").all()]


def test_page_offline(page):
    assert page.evaluate(EMPTY) == 0 and page.locator("img").count() > 20
    for width in (360, 1200):
        page.set_viewport_size({"width": width, "height": 780})
        content, window = page.evaluate(WIDE)
        assert content <= window, width

    assert shown(page, "film") == [True, True] and shown(page, "still") == [False, False]
    page.get_by_label("Still pictures").check()
    assert shown(page, "film") == [False, False] and shown(page, "still") == [True, True]
    page.get_by_label("Still pictures").uncheck()
    page.emulate_media(reduced_motion="reduce")
    assert shown(page, "film") == [False, False] and shown(page, "still") == [True, True]

    assert page.locator("#leaderboard details[open] table").count() >= 2  # one for each cell
    assert "<" not in page.locator("#leaderboard").inner_text()

    page.get_by_role("link", name="Look-alike poses").click()
    assert page.get_by_role("heading", name="Look-alike poses").is_visible()


def test_a_long_name_of_an_agent_is_broken(page):
    page.set_viewport_size({"width": 390, "height": 780})
    for kind in ("h4", "figcaption"):
        page.evaluate(f"document.querySelectorAll('{kind}').forEach(one => one.append('{'name_' * 8}'))")
        content, window = page.evaluate(WIDE)
        assert content <= window, kind


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [1280, 390])
def test_axe_finds_no_violation(page, scheme, width):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    page.emulate_media(color_scheme=scheme)
    page.set_viewport_size({"width": width, "height": 800})
    page.evaluate(UNFOLD)
    found = axe.run(page).response
    assert len(found["passes"]) > 10
    assert [(one["id"], [node["target"] for node in one["nodes"]]) for one in found["violations"]] == []
