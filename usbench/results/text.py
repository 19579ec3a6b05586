"""Numbers, names and tables as Markdown."""

import re
import textwrap
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import pandas as pd

DASH = "–"
# What needs no escape within HTML or Markdown, beside letters and digits.
PLAIN = " =.,:;-+/"
# Columns of a line of code, indent and backslash apart.
WIDEST = 72


def number(value: Any, digits: int) -> str:
    """Return a number with fixed digits, never -0; a dash where there is none."""
    return DASH if pd.isna(value) else f"{float(value):z.{digits}f}"


def interval(value: float, low: float, high: float, digits: int = 3) -> str:
    """Return a number with its interval in brackets; alone where it has none."""
    if pd.isna(low):
        return number(value, digits)
    return f"{number(value, digits)} {bounds(low, high, digits)}"


def bounds(low: float, high: float, digits: int = 3) -> str:
    """Return an interval in brackets; a dash where there is none."""
    return DASH if pd.isna(low) else f"[{number(low, digits)}, {number(high, digits)}]"


def code(name: str) -> str:
    """Return a name as code; with a bar, a backtick or HTML it stays within its cell of a table, too."""
    if not set(name) & set("|`<>&\n\r"):
        return f"`{name}`"
    return f"<code>{escaped(name)}</code>"


def escaped(name: str) -> str:
    """Return a name as plain text, in which nothing is markup."""
    return "".join(c if c.isalnum() or c in PLAIN else f"&#{ord(c)};" for c in name)


def listed(words: Iterable[str]) -> str:
    """Return words with commas between them; one that holds what may be markup stands as plain text."""
    markup = set("|`<>&[]*\n\r")
    return ", ".join(escaped(word) if markup & set(word) else word for word in words)


def agent(name: str, *notes: str) -> str:
    """Return the name of an agent in a table, with what is said of it; empty notes say nothing."""
    said = ", ".join(filter(None, notes))
    return f"{code(name)} ({said})" if said else code(name)


def names(agents: Sequence[str]) -> str:
    """Return names in a row: "`a`, `b` and `c`"."""
    return in_a_row([code(one) for one in agents])


def in_a_row(words: Sequence[str]) -> str:
    """Return words in a row: "a, b and c"."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def pairs_of(agents: Sequence[tuple[str, str]]) -> str:
    """Return who lies above whom: "`a` lies above `b`, `a` above `c`"."""
    (first, second), *others = agents
    rest = [f"{code(one)} above {code(two)}" for one, two in others]
    return ", ".join([f"{code(first)} lies above {code(second)}", *rest])


def capital(sentence: str) -> str:
    """Return the sentence with a capital letter first."""
    return sentence[0].upper() + sentence[1:]


def table(head: Sequence[str], rows: Iterable[Sequence[str]], words: int = 1) -> str:
    """Return a Markdown table; columns after the first ones, which hold `words`, are aligned to the right."""
    lines = [head, ["---"] * words + ["---:"] * (len(head) - words), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def frames(number: int) -> str:
    """Return how many frames there are, in words."""
    return f"{number} {'frame' if number == 1 else 'frames'}"


def rows(number: int) -> str:
    """Return how many rows there are, in words."""
    return f"{number} {'row' if number == 1 else 'rows'}"


def folded(summary: str, body: str) -> str:
    """Return Markdown that is folded under a summary of plain words."""
    return f"<details>\n<summary>{summary}</summary>\n\n{body}\n\n</details>"


def exact(value: float) -> str:
    """Return a number as a command takes it, with all of its digits: "0", "0.25"."""
    return np.format_float_positional(value, trim="-")


def in_lines(command: str) -> str:
    """Return a command over as many lines as a site shows without scrolling, for the shell to join again.

    An option and its first value stand on one line.
    """
    # textwrap takes a null for a letter.
    together = re.sub(r"(--\S+) ", "\\1\0", command)
    lines = textwrap.wrap(together, WIDEST, break_long_words=False, break_on_hyphens=False)
    return " \\\n    ".join(lines).replace("\0", " ")
