"""The built site in a real Chromium: axe-core finds nothing on seven pages (`make check-site`)."""

import os
import shutil
from pathlib import Path

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import sync_playwright

BUILT = Path(__file__).parents[2] / "build" / "docs"
PAGES = ("index", "tutorial", "environments/pp", "results", "api", "physics", "records")
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
pytestmark = [pytest.mark.site, pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium")]


@pytest.fixture(scope="module")
def browser():
    arguments = ["--disable-gpu", *(["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else [])]
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=arguments)
        yield browser
        browser.close()


@pytest.fixture(params=["light", "dark"])
def page(browser, request):
    page = browser.new_page(viewport={"width": 1280, "height": 900}, color_scheme=request.param)
    yield page
    page.close()


@pytest.mark.parametrize("name", PAGES)
def test_axe_finds_nothing(page, name):
    page.goto((BUILT / f"{name}.html").as_uri())
    found = Axe().run(page)
    named = {
        one["id"]: [node["html"][:120] for node in one["nodes"][:3]] for one in found.response["violations"]
    }
    assert named == {}


@pytest.mark.parametrize("name", PAGES)
def test_nothing_is_fetched_from_elsewhere(page, name):
    asked = []
    page.on("request", lambda request: asked.append(request.url))
    page.goto((BUILT / f"{name}.html").as_uri())
    assert [url for url in asked if not url.startswith(("file:", "data:"))] == []


def test_a_button_copies_the_commands_of_a_dialogue_alone(browser):
    context = browser.new_context(permissions=["clipboard-read", "clipboard-write"])
    page = context.new_page()
    page.goto((BUILT / "tutorial.html").as_uri())
    page.locator("div.highlight-console button.copybtn").first.click(force=True)
    page.wait_for_timeout(200)
    copied = page.evaluate("navigator.clipboard.readText()")
    context.close()
    assert copied.strip() == "usbench frame --x 10 --depth 35 --angle 60"


def test_outputs_have_no_button(page):
    page.goto((BUILT / "tutorial.html").as_uri())
    # What a command prints has no button.
    assert page.locator("div.highlight-text button.copybtn").count() == 0
    assert page.locator("div.highlight-bash button.copybtn").count() > 2


@pytest.fixture
def telephone(browser):
    page = browser.new_page(viewport={"width": 390, "height": 844})
    yield page
    page.close()


@pytest.mark.parametrize("name", PAGES)
def test_a_telephone_shows_the_whole_width_and_short_code_in_one_line(telephone, name):
    telephone.goto((BUILT / f"{name}.html").as_uri())
    assert telephone.evaluate("document.documentElement.scrollWidth") <= 390
    broken = "[...document.querySelectorAll('.whole')].filter(one => one.getClientRects().length > 1)"
    assert telephone.evaluate(f"{broken}.map(one => one.textContent)") == []
    assert telephone.locator(".whole").count() > 3


def test_a_telephone_breaks_names_between_their_parts(telephone):
    telephone.goto((BUILT / "api.html").as_uri())
    parts, broken = telephone.evaluate(
        """() => {
            const parts = [], broken = []
            for (const code of document.querySelectorAll("table code")) {
                const texts = document.createTreeWalker(code, NodeFilter.SHOW_TEXT)
                while (texts.nextNode()) {
                    const range = document.createRange()
                    range.selectNode(texts.currentNode)
                    parts.push(range.toString())
                    if (range.getClientRects().length > 1) broken.push(range.toString())
                }
            }
            return [parts, broken]
        }"""
    )
    assert {"observation.", "senses"} <= set(parts) and broken == []


@pytest.mark.parametrize("width", [390, 1280])
def test_no_formula_is_cut_off_above_or_below(browser, width):
    page = browser.new_page(viewport={"width": width, "height": 844})
    page.goto((BUILT / "physics.html").as_uri())
    room = page.evaluate(
        """[...document.querySelectorAll(".formula")].map(box => {
            const own = box.getBoundingClientRect()
            const parts = [...box.querySelectorAll("*")].map(part => part.getBoundingClientRect())
            return Math.min(...parts.map(part => Math.min(part.top - own.top, own.bottom - part.bottom)))
        })"""
    )
    page.close()
    assert len(room) == 11 and min(room) >= 0
