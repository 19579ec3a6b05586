"""The leaderboard at the top of the repository is what its committed tables give, to the byte."""

from pathlib import Path

import pytest

from usbench import leaderboard

TOP = Path(__file__).parents[1]


@pytest.mark.parametrize("name", ["leaderboard.md", "scores.csv"])
def test_committed_leaderboard_comes_from_the_committed_tables(tmp_path, name):
    leaderboard.write(leaderboard.files(TOP / "leaderboard.md"), tmp_path / "leaderboard.md")
    # `usbench compare` writes them, `usbench leaderboard` writes them again.
    assert (TOP / name).read_bytes() == (tmp_path / name).read_bytes()
