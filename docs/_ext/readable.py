"""What narrow screens ask of every page and the theme leaves out, written into the built pages.

Short code stays in one line, long code breaks between the parts of a name, and a picture leads to its file,
which can be enlarged.
"""

import re
from pathlib import Path

from sphinx.application import Sphinx

# Characters of code that stay in one line on the narrowest screens.
WHOLE = 20
CODE = re.compile(r"<code [^>]*>.*?</code>", re.DOTALL)
WORD = re.compile(r'<span class="pre">([^<]*)</span>')
# A picture, with the link that it stands in where there is one.
PICTURE = re.compile(r'(<a [^>]*>(?:<span [^>]*>)?)?<img [^>]*\bsrc="([^"]*_images/[^"]+)"[^>]*>')


def word(found: re.Match[str]) -> str:
    """Return a word of code with the places where it may break."""
    text = found[1]
    if len(text) <= WHOLE:
        return f'<span class="pre whole">{text}</span>'
    option = re.match(r"--[\w-]+", text)
    first = option[0] if option else ""
    parts = re.sub(r"([./=(]+)(?=\w)", r"\1\n", text[len(first) :]).split("\n")
    # A part that is long itself breaks between its words.
    parts = [re.sub(r"_(?=\w)", "_<wbr/>", part) if len(part) > WHOLE else part for part in parts]
    kept = f'<span class="whole">{first}</span>' if first else ""
    return f'<span class="pre">{kept}{"<wbr/>".join(parts)}</span>'


def picture(found: re.Match[str]) -> str:
    """Return a picture that leads to its file, if it leads nowhere else."""
    if found[1]:
        return found[0]
    return f'<a class="reference internal image-reference" href="{found[2]}">{found[0]}</a>'


def finish(app: Sphinx, failure: Exception | None) -> None:
    """Change the pages that were built; a page that is changed already stays as it is."""
    if failure is None and app.builder.name == "html":
        for path in Path(app.outdir).rglob("*.html"):
            page = path.read_text(encoding="utf-8")
            better = CODE.sub(lambda code: WORD.sub(word, code[0]), page)
            path.write_text(PICTURE.sub(picture, better), encoding="utf-8")


def setup(app: Sphinx) -> dict[str, bool]:
    """Run after the build."""
    app.connect("build-finished", finish)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
