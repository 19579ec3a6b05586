"""The program behind `make failures`: which trials its tables are of."""

import sys

import failures
import pytest

from usbench.records import Trial


def test_only_trials_of_the_grid_tell_how_episodes_end(finished, monkeypatch):
    assert failures.ends_of(finished.parent) is None  # of another seed, and of fewer steps
    monkeypatch.setattr(failures.plan, "by_protocol", lambda _: [Trial.read(finished).config])
    (row,) = failures.ends_of(finished.parent).to_dict("records")
    assert (row["task"], row["noise"], row["algo"], row["seeds"]) == ("pp", 0.5, "vpg", 1)


@pytest.mark.parametrize("option", ["--frames", "--budgets"])
def test_a_folder_that_is_not_there_is_refused(option, monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["failures.py", option, "nowhere"])
    with pytest.raises(SystemExit):
        failures.main()
    assert "there is no folder 'nowhere'" in capsys.readouterr().err
