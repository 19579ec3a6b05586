"""How long the guide's page takes from a key to the new frame, in a headless Chromium; and a picture of it.

Run `python benchmarks/guide.py best:pp [--pause 0.2] [--picture docs/guide.png]`, or with the folder of a
trial. The time counts from the key's event until Chromium has shown the new frame, as Chromium tells by the
Element Timing API, rounded up to 4 ms. `--pause` is how long each frame is looked at before the next key.
"""

import argparse
import os
import random
import shutil
import statistics
import threading
import time
from pathlib import Path
from typing import Any

import torch
from playwright.sync_api import expect, sync_playwright

from usbench import suite
from usbench.guide import server as guide_server
from usbench.guide.access import new_token
from usbench.guide.desk import Desk
from usbench.guide.session import Session
from usbench.setting import Setting

EPISODES = 8
KEYS = {"Space": " "}
REFRESH = 1 / 60  # s; pauses differ by up to one, so that no key falls in step with the screen
# Told by the page: whoever asks the page again and again slows it down.
TELL = """
new MutationObserver(() => console.log(document.getElementById("latency").textContent))
  .observe(document.getElementById("latency"), { childList: true });
"""


def main() -> None:
    """Measure, print a line, write the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("trial", type=Path)
    parser.add_argument("--pause", type=float, default=0.2, help="s before each key (default 0.2)")
    parser.add_argument("--picture", type=Path)
    args = parser.parse_args()
    torch.set_num_threads(1)  # as the command does
    session = Session(args.trial.parent, args.trial, seed=0)
    for task in suite.PAPER:
        Setting(task=task).prepare_frames()
    with guide_server.listening() as listener, sync_playwright() as playwright:
        token, desk = new_token(), Desk()
        server = guide_server.server(desk, token)
        desk.start(lambda _: session)
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]})
        browser = chromium(playwright)  # first: where it cannot start, nothing waits for the server
        thread.start()
        try:
            page = browser.new_page(viewport={"width": 1400, "height": 880})
            page.goto(guide_server.address(listener, token))
            expect(page.get_by_text("Step 0 of")).to_be_visible()
            page.evaluate(TELL)
            n_steps = session.setting.row.n_steps
            took = [ms for _ in range(EPISODES) for ms in episode(page, n_steps, args.pause)]
            ordered = sorted(took)
            print(
                f"key to frame, {len(took)} keys: median {statistics.median(took):.0f} ms, "
                f"9 of 10 within {ordered[len(took) * 9 // 10]} ms, longest {ordered[-1]} ms"
            )
            if args.picture:
                page.keyboard.press("n")
                expect(page.get_by_text("Step 0 of")).to_be_visible()
                press(page, 4, args.pause)
                page.screenshot(path=args.picture)
        finally:
            browser.close()
            server.should_exit = True
            desk.close()
            thread.join()


def chromium(playwright: Any) -> Any:
    """Return a headless Chromium; as root it runs without a sandbox."""
    root = hasattr(os, "geteuid") and os.geteuid() == 0
    return playwright.chromium.launch(
        executable_path=shutil.which("chromium") or shutil.which("google-chrome"),
        args=["--disable-gpu", *(["--no-sandbox"] if root else [])],
    )


def episode(page: Any, n_steps: int, pause: float) -> list[int]:
    """Play an episode of `n_steps` by the advised keys; return the time of each key in ms."""
    page.keyboard.press("n")
    expect(page.get_by_text(f"Step 0 of {n_steps}")).to_be_visible()
    return press(page, n_steps, pause)


def press(page: Any, steps: int, pause: float) -> list[int]:
    """Press the advised key `steps` times, each after `pause` s; return the time of each key in ms."""
    took = []
    for step in range(1, steps + 1):
        key = page.locator("#controls .advised").get_attribute("aria-keyshortcuts")
        time.sleep(pause + random.uniform(0, REFRESH))
        with page.expect_console_message() as told:
            page.keyboard.press(KEYS.get(key, key))
        took.append(int(told.value.text.removesuffix(" ms")))
        expect(page.get_by_text(f"Step {step} of")).to_be_visible()
    return took


if __name__ == "__main__":
    main()
