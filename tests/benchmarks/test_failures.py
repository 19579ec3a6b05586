"""The program behind `make failures`: which trials its tables are of."""

import sys

import failures
import pytest

from usbench.compare import plan, protocol
from usbench.records import Trial


def test_only_trials_that_are_planned_tell_how_episodes_end(finished):
    grid = plan.by_protocol(protocol.read())
    assert failures.ends_of(finished.parent, grid) is None  # of another seed, and of fewer steps
    (row,) = failures.ends_of(finished.parent, [Trial.read(finished).config]).to_dict("records")
    assert str(row) == str(failures.ends_of(finished.parent, []).to_dict("records")[0])
    assert (row["task"], row["noise"], row["algo"], row["seeds"]) == ("pp", 0.5, "vpg", 1)


@pytest.mark.parametrize("option", ["--frames", "--budgets"])
def test_a_folder_that_is_not_there_is_refused(option, monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["failures.py", option, "nowhere"])
    with pytest.raises(SystemExit):
        failures.main()
    assert "there is no folder 'nowhere'" in capsys.readouterr().err
