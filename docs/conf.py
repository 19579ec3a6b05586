"""The site: `make docs` builds it from these pages and the docstrings, without the internet."""

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from importlib.metadata import version as installed
from pathlib import Path, PurePosixPath
from typing import Any

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx

ROOT = Path(__file__).parents[1]
# File of the repository -> page of the site that shows it; folder -> package.
HERE = {"leaderboard.md": "results.md", "CHANGELOG.md": "changelog.md"}
# Of trained agents, and the page that shows all of them.
CARD, CARDS = "card.md", "cards.md"
PACKAGES = {"envs": "usbench.envs", "agents": "usbench.agents", "usbench": "usbench"}

sys.path.insert(0, str(Path(__file__).parent / "_ext"))


def repository() -> str:
    """Return where the repository is on the web, empty where CI and the clone's origin do not say."""
    if "GITHUB_REPOSITORY" in os.environ:
        return "{GITHUB_SERVER_URL}/{GITHUB_REPOSITORY}".format_map(os.environ)
    asked = ["git", "-C", str(ROOT), "remote", "get-url", "origin"]
    found = subprocess.run(asked, capture_output=True, text=True, check=False).stdout.strip()
    return found.removesuffix(".git") if found.startswith("https://") and "@" not in found else ""


project = "usbench"
copyright = "usbench contributors"
version = release = installed("usbench")

extensions = [
    "accessible",
    "mathml",
    "readable",
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinx_copybutton",
]
exclude_patterns = ["_ext", "_static", "_templates"]
templates_path = ["_templates"]
# Docstrings name code with single backticks.
default_role = "code"
# Of a package only what it defines itself: a name that it hands on is described where the name is from.
autodoc_default_options = {"members": True, "member-order": "bysource", "ignore-module-all": True}
autodoc_inherit_docstrings = False
autodoc_typehints_format = "short"
# As a list below the class: members of dataclasses would be described twice otherwise.
napoleon_use_ivar = True
python_maximum_signature_line_length = 90

highlight_language = "text"
myst_enable_extensions = ["dollarmath", "html_image"]
html_math_renderer = "mathml"
myst_heading_anchors = 3
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 300

html_theme = "furo"
html_title = f"usbench {version}"
html_show_sphinx = False
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_logo = "_static/logo.svg"
html_favicon = "_static/favicon.svg"
# A button stands beside commands and programs, not beside their output; of a dialogue it copies the commands.
copybutton_selector = ", ".join(f"div.highlight-{kind} pre" for kind in ("bash", "console", "python", "toml"))
copybutton_prompt_text = r"\$ |>>> |\.\.\. "
copybutton_prompt_is_regexp = True
html_theme_options: dict[str, Any] = {"top_of_page_buttons": []}
if repository():
    html_theme_options |= {
        "source_repository": repository(),
        "source_branch": "main",
        "source_directory": "docs/",
        "footer_icons": [{"name": "repository", "url": repository(), "html": "repository", "class": ""}],
    }


def link_modules(app: Sphinx, doctree: nodes.document) -> None:
    """Lead links to a module's file, as readers of the repository need them, to its page of the reference."""
    for link in list(doctree.findall(addnodes.download_reference)):
        place = (Path(app.srcdir) / app.env.docname).parent / link["reftarget"].lstrip("/")
        path = PurePosixPath(place.resolve().relative_to(ROOT).as_posix())
        package = PACKAGES.get(path.parts[0])
        if package and path.suffix == ".py":
            name = ".".join((package, *path.parts[1:-1], path.stem))
            reference: Any = addnodes.pending_xref(
                "", *link.children, refdomain="py", reftype="mod", reftarget=name, refexplicit=True
            )
            link.replace_self(reference)


def link_pages(app: Sphinx, page: str, source: list[str]) -> None:
    """Lead links to pages and folders outside of docs/ to their page here, or else to the repository."""
    folder = (Path(app.srcdir) / page).parent

    def led(link: re.Match[str]) -> str:
        words, place, heading = link.groups(default="")
        path = (folder / place).resolve()
        if path.is_relative_to(app.srcdir) or not path.exists() or path.suffix not in ("", ".md"):
            return link[0]
        within = path.relative_to(ROOT).as_posix()
        if path.name == CARD:
            heading = heading or f"#{_place(path)}"
            return f"[{words}]({os.path.relpath(Path(app.srcdir) / CARDS, folder)}{heading})"
        if within in HERE:
            return f"[{words}]({os.path.relpath(Path(app.srcdir) / HERE[within], folder)}{heading})"
        return f"[{words}]({repository()}/blob/main/{within}{heading})" if repository() else words

    source[0] = re.sub(r"(?<!!)\[([^\]]+)\]\(([^)\s#:]+)(#[^)\s]+)?\)", led, source[0])


def link_names(app: Sphinx, doctree: nodes.document, page: str) -> None:
    """Lead names of pages in plain text, as the leaderboard has them, to these pages, by their titles."""
    for text in list(doctree.findall(nodes.Text)):
        parts = re.split(r"\bdocs/([\w/]+)\.md\b", text.astext())
        kinds = (nodes.reference, nodes.literal, nodes.literal_block)
        if len(parts) == 1 or any(isinstance(node, kinds) for node in _around(text)):
            continue
        found: list[nodes.Node] = []
        for plain, name in zip(parts[::2], [*parts[1::2], ""], strict=True):
            found.append(nodes.Text(plain))
            if name:
                title = re.sub("^The ", "the ", app.env.titles[name].astext())
                uri = app.builder.get_relative_uri(page, name)
                found.append(nodes.reference("", title, refuri=uri, internal=True))
        text.parent.replace(text, found)


def _around(node: nodes.Node) -> Iterator[nodes.Node]:
    """Yield what a node stands in, from the inside to the outside."""
    while node.parent is not None:
        node = node.parent
        yield node


def _place(page: Path) -> str:
    """Return how links name the title of a page, as `myst_heading_anchors` makes it."""
    title = page.read_text(encoding="utf-8").partition("\n")[0].removeprefix("# ")
    return re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-")


def plain_words(app: Sphinx, what: str, name: str, value: Any, options: Any, lines: list[str]) -> None:
    """Translate the Markdown headings of environments, as Gymnasium has them, and keep |absolute values|."""
    translated: list[str] = []
    for line in lines:
        heading = re.fullmatch(r"## (.+)", line)
        if heading:
            translated += [f".. rubric:: {heading[1]}", ""]
        else:
            translated.append(re.sub(r"(`[^`]*`)|\|", lambda part: part[1] or r"\|", line))
    lines[:] = translated


def setup(app: Sphinx) -> None:
    """Connect what is above."""
    app.connect("autodoc-process-docstring", plain_words)
    app.connect("source-read", link_pages)
    app.connect("doctree-resolved", link_names)
    # Before Sphinx copies the files that links lead to.
    app.connect("doctree-read", link_modules, priority=400)
