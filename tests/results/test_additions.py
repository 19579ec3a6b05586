"""Trials that are added to tables: what counts, what is told, and which seeds are refused."""

import pandas as pd
import pytest
from made_tables import made, trial

from usbench.checks import ConfigurationError
from usbench.results import additions, sources, tables


def test_trials_that_are_added_to_tables_give_what_all_together_give():
    rows = [trial("vpg", 0.5, seed=seed, total_s=float(seed)) for seed in (100, 101, 102)]
    together = made(*rows)
    for known, added in ((rows[:1], rows[1:]), (rows[1:], rows[:1])):
        found = additions.add(made(*known), made(*added)).results
        pd.testing.assert_frame_equal(found.trials, together.trials)
        pd.testing.assert_frame_equal(found.curves, together.curves)


def test_of_trials_in_both_those_with_other_numbers_are_told():
    old = [trial("vpg", 0.5, seed=seed) for seed in (100, 101, 102)]
    new = [trial("vpg", 0.5, seed=100), trial("vpg", 0.6, seed=101), trial("vpg", 0.5, seed=103)]
    for replace, found in ((False, [new[2]]), (True, new[1:])):
        addition = additions.add(made(*old), made(*new), replace=replace)
        assert addition.same == [old[0]["trial"]]
        assert addition.other == [additions.Difference(old[1]["trial"], 0.5, 0.6)]
        assert addition.new == [one["trial"] for one in found]


@pytest.mark.parametrize(
    ("old", "new", "score", "replace", "wanted"),
    [
        ("finished", "finished", 0.5, False, "old"),
        ("finished", "finished", 0.5, True, "old"),  # the same numbers: nothing is to change
        ("finished", "finished", 0.6, False, "old"),  # what was published stays
        ("finished", "finished", 0.6, True, "new"),
        ("failed", "finished", 0.5, False, "new"),
        ("finished", "failed", 0.5, True, "old"),
    ],
)
def test_of_a_trial_in_both_that_of_the_tables_stays_unless_it_is_to_be_replaced(
    old, new, score, replace, wanted
):
    known = {
        "old": made(trial("vpg", 0.5, seed=100, status=old, total_s=1.0)),
        "new": made(trial("vpg", score, seed=100, status=new, total_s=2.0)),
    }
    found = additions.add(known["old"], known["new"], replace=replace).results
    pd.testing.assert_frame_equal(found.trials, known[wanted].trials)
    pd.testing.assert_frame_equal(found.curves, known[wanted].curves, check_dtype=False)


def test_what_is_in_a_row_of_its_own_is_told():
    settings = '{"environment": "e", "gamma": 0.9}'
    known = made(trial("vpg", seed=100), trial("vpg", seed=101))
    mine = trial("vpg", seed=100, trial="mine", configuration="00000002", settings=settings)
    assert additions.add(known, made(mine, trial("ppo", seed=100))).apart == {"mine": "vpg gamma=0.9"}


@pytest.mark.parametrize(
    ("seed", "said"), [(0, "0, which is of the pool for development"), (1003, "search"), (5000, "no pool")]
)
def test_new_trial_with_a_seed_of_another_pool_is_refused(seed, said):
    mine = trial("vpg", seed=seed, trial="mine")
    with pytest.raises(ConfigurationError, match=f"mine cannot be added: a comparison takes seeds.*{said}"):
        additions.add(made(trial("vpg", seed=100)), made(mine))


def test_a_trial_with_the_name_of_another_is_refused():
    known = trial("ppo", 1.0, seed=100)
    mine = trial("vpg", 0.1, seed=100, trial=known["trial"])
    with pytest.raises(ConfigurationError, match=f"{known['trial']} is the name of two trials"):
        additions.add(made(known), made(mine))


def test_seeds_of_known_trials_and_of_agents_that_do_not_learn_are_free():
    # Tables of earlier versions have seeds from 0 on, and can be verified.
    known = made(trial("vpg", 0.5, seed=0))
    addition = additions.add(known, made(trial("vpg", 0.5, seed=0), trial("oracle", 1.0, seed=0)))
    assert addition.same == [known.trials["trial"][0]] and len(addition.results.trials) == 2


def test_an_unfinished_trial_has_nothing_to_verify():
    known = made(trial("vpg", seed=100))
    for added in (made(trial("vpg", seed=100, status="interrupted")), made(trial("ppo", status="running"))):
        assert additions.add(known, added).new == []
    added = made(trial("vpg", 0.6, seed=100), trial("ppo", seed=101))
    assert additions.add(known, added).new == [added.trials["trial"][1]]
    assert additions.add(known, added, replace=True).new == list(added.trials["trial"])


def test_the_packages_tables_come_with_the_names_that_are_not_verified(monkeypatch, tmp_path):
    package, own = tmp_path / "package", tmp_path / "own"
    own.mkdir()
    monkeypatch.setattr(sources, "published", lambda: package)
    tables.write(made(trial()), package)
    additions.mark_unverified(package, [], ["mine"])
    assert sources.bring_published(own) and additions.unverified(own) == ["mine"]
