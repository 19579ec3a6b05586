"""How long it takes from `usbench guide` to the first advice in the browser, with no frame or table kept.

Run `python benchmarks/first_advice.py`, or with arguments of the guide, such as `--task pp-random`. Chromium
runs before the time counts, as a person's browser does.
"""

import os
import resource
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from guide import chromium
from playwright.sync_api import sync_playwright

PATIENCE_MS = 120_000


def main() -> None:
    """Start a guide; print when it told its address and when its page showed advice."""
    with TemporaryDirectory() as folder, sync_playwright() as playwright:
        browser = chromium(playwright)
        page = browser.new_page()
        page.set_default_timeout(PATIENCE_MS)
        page.goto("about:blank")
        since = time.perf_counter()
        # In a folder without trials, as after the installation.
        guide = subprocess.Popen(
            [Path(sys.executable).with_name("usbench"), "guide", "--no-browser", *sys.argv[1:]],
            stdout=subprocess.PIPE,
            text=True,
            cwd=folder,
            env={**os.environ, "USBENCH_CACHE": folder},
        )
        try:
            assert guide.stdout is not None
            address = next(word for word in guide.stdout.readline().split() if word.startswith("http"))
            told = time.perf_counter() - since
            page.goto(address)
            page.locator("#controls .advised").wait_for()
            advised = time.perf_counter() - since
            adviser = page.locator("#adviser").text_content()
        finally:
            guide.terminate()
            guide.wait()
            browser.close()
        # Of the guide alone: Chromium is no child of this process.
        spent = resource.getrusage(resource.RUSAGE_CHILDREN)
        print(
            f"{' '.join(['usbench guide', *sys.argv[1:]])}: address after {told:.1f} s, advice {adviser} "
            f"after {advised:.1f} s; {spent.ru_utime + spent.ru_stime:.1f} s of CPU time"
        )


if __name__ == "__main__":
    main()
