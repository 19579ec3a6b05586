"""Code in the pages breaks where a reader expects it, and pictures lead to their files."""

import runpy
from pathlib import Path

import pytest

pytest.importorskip("sphinx")
WRITER = runpy.run_path(str(Path(__file__).parents[2] / "docs" / "_ext" / "readable.py"))
pytestmark = pytest.mark.site


@pytest.mark.parametrize(
    ("text", "written"),
    [
        ("--n-frames", '<span class="pre whole">--n-frames</span>'),
        ("pp-random", '<span class="pre whole">pp-random</span>'),
        ("held_out.csv", '<span class="pre whole">held_out.csv</span>'),
        (
            "usbench.envs.observation.senses",
            '<span class="pre">usbench.<wbr/>envs.<wbr/>observation.<wbr/>senses</span>',
        ),
        (
            "--leaderboard=mine/leaderboard.md",
            '<span class="pre"><span class="whole">--leaderboard</span>=<wbr/>mine/<wbr/>leaderboard.<wbr/>md'
            "</span>",
        ),
        (
            "too_long_a_name_for_one_line",
            '<span class="pre">too_<wbr/>long_<wbr/>a_<wbr/>name_<wbr/>for_<wbr/>one_<wbr/>line</span>',
        ),
    ],
)
def test_code_breaks_between_the_parts_of_a_name(text, written):
    once = WRITER["WORD"].sub(WRITER["word"], f'<span class="pre">{text}</span>')
    assert once == written
    # A page that is changed already stays as it is.
    assert WRITER["WORD"].sub(WRITER["word"], once) == once


def test_a_picture_leads_to_its_file_unless_it_leads_elsewhere():
    alone = '<img alt="A" src="../_images/a.png" />'
    linked = f'<a class="reference internal image-reference" href="../_images/a.png">{alone}</a>'
    assert WRITER["PICTURE"].sub(WRITER["picture"], alone) == linked
    for other in (
        linked,
        f'<a href="pp.html"><span class="std">{alone}</span></a>',
        '<img src="_static/a.svg" />',
    ):
        assert WRITER["PICTURE"].sub(WRITER["picture"], other) == other
