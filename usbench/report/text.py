"""The leaderboard's Markdown as HTML: the same words and numbers, in tables that scroll and have captions."""

import re
from collections.abc import Collection, Iterator, Sequence

from markdown_it import MarkdownIt
from markdown_it.token import Token
from markupsafe import Markup, escape

from usbench.results import leaderboard
from usbench.results.tables import Results

CAPTIONS = {
    "together": "normalised scores, without unit",
    "Probability of improvement": "probability that the agent of a row beats that of a column",
    "Stability of ranks": "ranks, without unit",
}
_HEADING = re.compile(r"^## (.+)$", re.MULTILINE)
# What `usbench.results.text.folded` writes around a part, each in a paragraph of its own.
_FOLD, _FOLD_END = re.compile(r"<details>\s*<summary>([^<>]*)</summary>"), "</details>"
# Nothing that could lead out of the page: names and reasons in records may be a stranger's.
_MARKDOWN = MarkdownIt("zero").enable(["table", "list", "fence", "backticks", "emphasis", "entity"])


def sections(known: Results, changed: Collection[str] = ()) -> dict[str, Markup]:
    """Return the parts of the leaderboard by their headings, in its order.

    `changed` are names of trials with another environment than their task's.
    """
    _, *parts = _HEADING.split(leaderboard.markdown(known, changed=changed))
    return {
        title: html(text, caption=f"{title}: {_unit(title)}")
        for title, text in zip(parts[::2], parts[1::2], strict=True)
    }


def _unit(title: str) -> str:
    return next((text for part, text in CAPTIONS.items() if part in title), "scores and returns have no unit")


def html(markdown: str, caption: str = "") -> Markup:
    """Return `markdown` as HTML; a table in it takes `caption`, folded parts are open at first."""
    tokens: list[Token] = []
    for token in _with_folds(_MARKDOWN.parse(markdown)):
        if token.type == "table_open":
            tokens += [
                _raw(scroller(caption)),
                token,
                _raw(f"<caption><span>{escape(caption)}</span></caption>"),
            ]
        elif token.type == "table_close":
            tokens += [token, _raw("</div>")]
        else:
            tokens.append(token)
    _name_headers(tokens)
    return Markup(_MARKDOWN.renderer.render(tokens, _MARKDOWN.options, {}))


def inline(markdown: str) -> Markup:
    """Return a line of `markdown` as HTML without a paragraph around it."""
    return Markup(_MARKDOWN.renderInline(markdown))


def scroller(caption: str) -> Markup:
    """Return the opening of a box that a wide table scrolls in, by keyboard too."""
    return Markup('<div class="scroll" role="region" tabindex="0" aria-label="{}">').format(caption)


def _with_folds(tokens: Sequence[Token]) -> Iterator[Token]:
    """Yield `tokens` with an element in place of each paragraph that begins or ends a folded part."""
    k = 0
    while k < len(tokens):
        inside = tokens[k + 1].content if tokens[k].type == "paragraph_open" else ""
        fold = _FOLD.fullmatch(inside)
        if fold:
            yield _raw(f"<details open><summary>{escape(fold[1])}</summary>\n")
        elif inside == _FOLD_END:
            yield _raw("</details>\n")
        else:
            yield tokens[k]
            k += 1
            continue
        k += 3


def _name_headers(tokens: list[Token]) -> None:
    """Make the first cell of every row in the body its header."""
    first = False
    for token in tokens:
        if token.type == "tr_open":
            first = True
        elif token.type == "th_open":
            token.attrSet("scope", "col")
        elif token.type == "td_open" and first:
            token.tag = "th"
            token.attrSet("scope", "row")
        elif token.type == "td_close" and first:
            token.tag, first = "th", False


def _raw(text: str) -> Token:
    # No Markup: markdown-it-py 3 and 4.0 join it with the rest, which it then escapes.
    return Token("html_block", "", 0, content=str(text))
