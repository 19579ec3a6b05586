"""The built site in a real Chromium: axe-core finds nothing on five pages (`make check-site`)."""

import os
import shutil
from pathlib import Path

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import sync_playwright

BUILT = Path(__file__).parents[2] / "build" / "docs"
PAGES = ("index", "tutorial", "environments/pp", "results", "api")
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
pytestmark = pytest.mark.site


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
