"""The program behind `make failures`: which trials its tables are of."""

import failures

from usbench.records import Trial


def test_only_trials_of_the_grid_tell_how_episodes_end(finished, monkeypatch):
    assert failures.ends_of(finished.parent) is None  # of another seed, and of fewer steps
    monkeypatch.setattr(failures.plan, "by_protocol", lambda _: [Trial.read(finished).config])
    (row,) = failures.ends_of(finished.parent).to_dict("records")
    assert (row["task"], row["noise"], row["algo"], row["seeds"]) == ("pp", 0.5, "vpg", 1)
