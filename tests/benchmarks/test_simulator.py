"""The simulator's table says which of its rows are what is asked."""

import re
from pathlib import Path

import pytest
from simulation.measuring import reached

PAGE = Path(__file__).parents[2] / "docs" / "physics.md"


@pytest.mark.parametrize(
    ("measured", "asked", "said"),
    [
        ("0.99874", "at least 0.998", "yes"),
        ("56", "at least 75", "no"),
        ("1.23 dB", "at most 1 dB", "no"),
        ("1 dB", "at most 1 dB", "yes"),
        ("449 MB", "", ""),
        ("", "", ""),
    ],
)
def test_a_number_is_what_is_asked_or_not(measured, asked, said):
    assert reached(measured, asked) == said


def test_the_page_says_of_every_row_whether_it_is_what_is_asked():
    table = PAGE.read_text().split("| what | measured | asked | reached |")[1].split("\n\n")[0]
    rows = [[cell.strip() for cell in row.strip("|").split("|")] for row in table.split("\n")[2:]]
    assert len(rows) > 40 and {len(row) for row in rows} == {4}
    for _, measured, asked, said in rows:
        assert re.fullmatch(r"(at least|at most) [\d.]+( \w+)?|", asked) and said == reached(measured, asked)
    assert sum(said == "no" for *_, said in rows) == 8
