"""The page in a real Chromium without a network: nothing missing, too wide or moving against a wish."""

import os
import shutil

import pytest

from usbench.envs import guidance
from usbench.report import page as report

sync_api = pytest.importorskip("playwright.sync_api")
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium")
PATIENCE_MS = 60_000
WIDE = "[document.documentElement.scrollWidth, document.documentElement.clientWidth]"
EMPTY = "[...document.images].filter(one => !one.complete || !one.naturalWidth).length"


def shown(page, kind):
    return [image.is_visible() for image in page.locator(f"img.{kind}").all()]


def test_page_offline(finished, tmp_path, monkeypatch):
    monkeypatch.setattr("usbench.report.poses.frame_store", guidance.frame_store)
    path = report.write(finished, tmp_path / "report.html")
    arguments = ["--disable-gpu", *(["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else [])]
    problems = []
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=arguments)
        context = browser.new_context(offline=True, viewport={"width": 360, "height": 780})
        page = context.new_page()
        page.set_default_timeout(PATIENCE_MS)
        page.on("console", lambda message: problems.append(message.text))
        page.on("pageerror", lambda error: problems.append(str(error)))
        page.on("requestfailed", lambda request: problems.append(request.url[:100]))
        page.goto(path.as_uri())

        assert page.evaluate(EMPTY) == 0 and page.locator("img").count() > 20
        for width in (360, 1200):
            page.set_viewport_size({"width": width, "height": 780})
            content, window = page.evaluate(WIDE)
            assert content <= window, width

        assert shown(page, "film") == [True] and shown(page, "still") == [False]
        page.get_by_label("Still pictures").check()
        assert shown(page, "film") == [False] and shown(page, "still") == [True]
        page.get_by_label("Still pictures").uncheck()
        page.emulate_media(reduced_motion="reduce")
        assert shown(page, "film") == [False] and shown(page, "still") == [True]

        page.get_by_role("link", name="Look-alike poses").click()
        assert page.get_by_role("heading", name="Look-alike poses").is_visible()
        browser.close()
    assert problems == []
