"""How long it takes from `usbench guide` to the first advice in the browser, with no frame or table kept.

Run `python benchmarks/first_advice.py`, or with arguments of the guide, such as `--task pp-random`. Chromium
runs before the time counts, as a person's browser does. With `--clone` the time counts from `git clone` on:
the repository is cloned and installed as README.md says, and the guide is the installed one.
"""

import argparse
import os
import resource
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from guide import chromium
from playwright.sync_api import Page, sync_playwright

ROOT = Path(__file__).parents[1]
PATIENCE_MS = 120_000


def installed(folder: Path) -> Path:
    """Clone the repository into a folder, install it as README.md says, and return its command."""
    clone, environment = folder / "usbench", folder / "environment"
    subprocess.run(["git", "clone", "--quiet", ROOT, clone], check=True)
    subprocess.run([sys.executable, "-m", "venv", environment], check=True)
    pip: list[str | Path] = [environment / "bin/pip", "install", "--quiet"]
    subprocess.run([*pip, "-c", "constraints.txt", "-e", ".[guide]"], check=True, cwd=clone)
    return environment / "bin/usbench"


def first_advice(page: Page, command: Path, arguments: list[str], folder: Path) -> tuple[float, float, str]:
    """Start a guide, and return when it told its address, when its page showed advice, and whose."""
    since = time.perf_counter()
    # In a folder without trials, as after the installation.
    guide = subprocess.Popen(
        [command, "guide", "--no-browser", *arguments],
        stdout=subprocess.PIPE,
        text=True,
        cwd=folder,
        env={**os.environ, "USBENCH_CACHE": str(folder)},
    )
    try:
        assert guide.stdout is not None
        address = next(word for word in guide.stdout.readline().split() if word.startswith("http"))
        told = time.perf_counter() - since
        page.goto(address)
        page.locator("#controls .advised").wait_for()
        advised = time.perf_counter() - since
        return told, advised, page.locator("#adviser").text_content() or ""
    finally:
        guide.terminate()
        guide.wait()


def main() -> None:
    """Print when the guide told its address and when its page showed advice."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--clone", action="store_true", help="clone and install usbench first, and count that too"
    )
    args, arguments = parser.parse_known_args()
    with TemporaryDirectory() as name, sync_playwright() as playwright:
        folder = Path(name)
        browser = chromium(playwright)
        page = browser.new_page()
        page.set_default_timeout(PATIENCE_MS)
        page.goto("about:blank")
        since = time.perf_counter()
        command = installed(folder) if args.clone else Path(sys.executable).with_name("usbench")
        installation = time.perf_counter() - since
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        told, advised, adviser = first_advice(page, command, arguments, folder)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)  # of the guide alone: Chromium is no child
        browser.close()
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    print(
        f"{' '.join(['usbench guide', *arguments])}: address after {told:.1f} s, advice {adviser} "
        f"after {advised:.1f} s; {spent:.1f} s of CPU time"
    )
    if args.clone:
        total = installation + advised
        print(f"clone and installation {installation:.1f} s, from `git clone` to advice {total:.1f} s")


if __name__ == "__main__":
    main()
