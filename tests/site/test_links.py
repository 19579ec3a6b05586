"""Links within the built site arrive and no page shows an error; `make check-links` asks other sites."""

import re
import socket
import urllib.error
import urllib.parse
import urllib.request
from html.parser import HTMLParser
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
BUILT = ROOT / "build" / "docs"
SOURCES = [
    *(ROOT / name for name in ("README.md", "CHANGELOG.md", "CONTRIBUTING.md", "CITATION.cff")),
    *sorted((ROOT / "docs").rglob("*.md")),
    *sorted((ROOT / "docs").glob("*.ipynb")),
]
ADDRESS = re.compile(r"https?://[^\s\\\"'`<>()\[\]{}|]+")
# Examples of addresses, and what is a folder for programs.
NOT_PAGES = ("http://127.0.0.1", "http://localhost", "https://download.pytorch.org/whl")
PATIENCE = 20  # s
# Answers by which a site says that the page is not there; others refuse programs or are busy.
GONE = (404, 410)
pytestmark = pytest.mark.site


class Page(HTMLParser):
    """The places of a page that links may name, its links, and its pictures' words."""

    def __init__(self, path):
        super().__init__()
        self.places, self.links, self.pictures, self.leads_nowhere, self.link = set(), [], [], [], None
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attributes):
        if tag == "a":
            self.link = dict(attributes).get("href")
        if tag == "img":
            self.pictures.append(dict(attributes).get("alt") or "")
            self.leads_nowhere += [] if self.link else [dict(attributes)["src"]]
        for name, value in attributes:
            if name == "id" or (tag == "a" and name == "name"):
                self.places.add(value)
            elif name in ("href", "src") and value is not None:
                self.links.append(value)

    def handle_endtag(self, tag):
        if tag == "a":
            self.link = None


def addresses():
    """Return the addresses of other sites that the pages name."""
    found = {link.rstrip(".,;:") for path in SOURCES for link in ADDRESS.findall(path.read_text("utf-8"))}
    return sorted(link for link in found if not link.startswith(NOT_PAGES) and "{" not in link)


def answer(address):
    """Return the status with which a site answers for an address."""
    request = urllib.request.Request(address, headers={"User-Agent": "Mozilla/5.0 (usbench check-links)"})
    try:
        with urllib.request.urlopen(request, timeout=PATIENCE) as response:
            return response.status
    except urllib.error.HTTPError as error:
        return error.code


def is_reached(address):
    """Say whether a site answers, whatever it answers."""
    try:
        answer(address)
    except OSError:
        return False
    return True


@pytest.fixture(scope="session")
def internet():
    """Skip where two of three large sites cannot be reached: one may be a mirror, or down."""
    if sum(is_reached(f"https://{host}") for host in ("github.com", "pypi.org", "doi.org")) < 2:
        pytest.skip("there is no internet here, so that addresses of other sites are not checked")


def test_links_within_the_site_arrive():
    pages = {path.resolve(): Page(path) for path in BUILT.rglob("*.html")}
    assert len(pages) > 50
    missing = set()
    for path, page in pages.items():
        for link in page.links:
            parts = urllib.parse.urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            place = (path.parent / urllib.parse.unquote(parts.path)).resolve() if parts.path else path
            if not place.exists() or (
                parts.fragment and place in pages and parts.fragment not in pages[place].places
            ):
                missing.add(f"{path.relative_to(BUILT)}: {link}")
    assert sorted(missing) == []


def test_every_picture_has_words():
    """Where a page gives none, the site takes the name of the file."""
    found = {
        (path.relative_to(BUILT).as_posix(), words)
        for path in BUILT.rglob("*.html")
        for words in Page(path).pictures
    }
    assert len(found) > 50
    assert [one for one in sorted(found) if not one[1].strip() or re.search(r"\.\w{3,4}$", one[1])] == []


def test_pages_are_named_by_links():
    """The leaderboard names a page by its file, which is right in the repository alone."""
    found = {
        (path.name, name)
        for path in BUILT.glob("*.html")
        for name in re.findall(
            r"docs/\w+\.md",
            re.sub(r"<(code|pre)\b.*?</\1>", "", path.read_text(encoding="utf-8"), flags=re.DOTALL),
        )
    }
    assert found == set()
    assert (BUILT / "results.html").read_text(encoding="utf-8").count(
        'href="comparison.html">the comparison<'
    ) >= 3


def test_every_picture_leads_somewhere():
    """On a telephone nobody reads a figure of 350 pixels: its file can be enlarged."""
    found = {(path.name, src) for path in BUILT.rglob("*.html") for src in Page(path).leads_nowhere}
    assert {one for one in found if "_static/" not in one[1]} == set()


def test_no_notebook_shows_an_error():
    """A picture that cannot be shown ends no notebook: its page has a traceback in the picture's place."""
    written = [path for path in BUILT.rglob("*.html") if "_modules" not in path.parts]
    assert [path.name for path in written if "Traceback (most recent call last)" in _text(path)] == []


def _text(path):
    return re.sub(r"<[^>]+>", "", path.read_text(encoding="utf-8"))


@pytest.mark.links
@pytest.mark.parametrize("address", addresses())
def test_pages_of_other_sites_are_there(internet, address):
    try:
        status = answer(address)
    except (TimeoutError, ConnectionError):
        pytest.skip(f"{address} does not answer")
    except urllib.error.URLError as error:
        if isinstance(error.reason, socket.gaierror):
            pytest.fail(f"{address}: there is no such site")
        pytest.skip(f"{address} does not answer: {error.reason}")
    assert status not in GONE, f"{address}: the site answers {status}"
