"""What axe-core asks of every page and the theme leaves out, written into the built pages."""

import re
from pathlib import Path

from sphinx.application import Sphinx

# Each changes nothing the second time.
CHANGES = (
    (r'<p class="caption" role="heading">', '<p class="caption" role="heading" aria-level="2">'),
    (r'<aside class="sidebar-drawer">', '<aside class="sidebar-drawer" aria-label="pages">'),
    (r'<aside class="toc-drawer([^"]*)">', r'<aside class="toc-drawer\1" aria-label="on this page">'),
    (r'<th class="head( stub)?"><p></p></th>', "<td></td>"),
    # Whatever scrolls can be reached with the keyboard.
    (r'<div class="(table-wrapper[^"]*)">', r'<div class="\1" role="group" tabindex="0" aria-label="table">'),
    (r"<pre>", '<pre tabindex="0">'),
    (
        r'<div class="(cell_output[^"]*)">',
        r'<div class="\1" role="group" tabindex="0" aria-label="output">',
    ),
    # Of the tables that pandas writes.
    (r"<th></th>", "<td></td>"),
)


def finish(app: Sphinx, failure: Exception | None) -> None:
    """Change the pages that were built."""
    if failure is None and app.builder.name == "html":
        for path in Path(app.outdir).rglob("*.html"):
            page = path.read_text(encoding="utf-8")
            for what, better in CHANGES:
                page = re.sub(what, better, page)
            path.write_text(page, encoding="utf-8")


def setup(app: Sphinx) -> dict[str, bool]:
    """Run after the build."""
    app.connect("build-finished", finish)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
