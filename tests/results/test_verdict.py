"""The answer in two sentences: careful in every case."""

import pytest
from made_tables import made, seeds, trial

from usbench.results import verdict

LOW, MIDDLE, HIGH = [0.50, 0.51, 0.52, 0.53], [0.60, 0.65, 0.70, 0.75], [0.90, 0.91, 0.92, 0.93]


def sentences(*trials):
    text = verdict.text(made(*trials))
    first, second = text.removesuffix(".").split(". ")
    return first, second


def test_nothing_finished():
    first, second = sentences(trial("vpg", status="running"), trial("ppo", status="missing"))
    assert first.endswith("is open: no algorithm has finished trials in every cell")
    assert second == "0 of 2 trials are finished; `usbench compare`, run again, adds the rest"


def test_no_trials_at_all():
    assert "0 of 0 trials" in sentences()[1]


def test_reference_policies_alone_answer_nothing():
    assert "is open" in sentences(trial("oracle", 1.0), trial("random", 0.0))[0]


def test_another_is_better():
    first, second = sentences(*seeds("vpg", MIDDLE), *seeds("ppo", HIGH), *seeds("a2c", LOW))
    assert first.startswith("`ppo` comes closest to the optimum, with a normalised score of 0.92 [0.9")
    assert "over the only cell with 4 seeds" in first and "told apart" not in first
    assert second.startswith(
        "Other methods do better than the paper's vanilla policy gradient (`vpg`, 0.68 ["
    )
    assert "`ppo` lies above it, `a2c` lies below it" in second
    assert second.endswith("a trial of `ppo` beats one of `vpg` with probability 1.00 [1.00, 1.00]")


def test_its_own_is_best():
    first, second = sentences(*seeds("vpg", HIGH), *seeds("ppo", LOW), *seeds("a2c", MIDDLE))
    assert first.startswith("`vpg` comes closest")
    assert second.startswith("No other method does better than the paper's vanilla policy gradient")
    assert "`a2c` and `ppo` lie below it" in second
    assert second.endswith("a trial of `a2c` beats one of `vpg` with probability 0.00 [0.00, 0.00]")


def test_overlap_is_no_victory():
    first, second = sentences(*seeds("vpg", MIDDLE), *seeds("ppo", [0.62, 0.66, 0.73, 0.78]))
    assert "`ppo` comes closest" in first and first.endswith("`vpg` cannot be told apart from it")
    assert second.startswith("Whether other methods do better than") and "cannot be told" in second
    assert "`ppo` lies too close for these seeds" in second


def test_equal_scores():
    _, second = sentences(*seeds("vpg", MIDDLE), *seeds("ppo", MIDDLE))
    assert "cannot be told" in second and "probability 0.50 [" in second


def test_one_seed_tells_nothing_of_the_spread():
    first, second = sentences(trial("vpg", 0.2), trial("ppo", 0.9))
    assert "a normalised score of 0.90 over the only cell with one seed" in first
    assert "cannot be told" in second and second.endswith("with probability 1.00")


def test_one_seed_beside_several_is_not_judged():
    text = verdict.text(made(*seeds("vpg", LOW), *seeds("ppo", HIGH), trial("a2c", 1.0), trial("trpo", 0.0)))
    assert text.startswith("`ppo` comes closest to the optimum")
    assert text.endswith("so that `a2c` and `trpo` must wait.") and text.count("a2c") == 1


def test_missing_trials_are_said():
    first, second = sentences(
        *seeds("vpg", LOW), *seeds("ppo", HIGH), trial("ppo", seed=4, status="missing"), trial("oracle", 1.0)
    )
    assert first.startswith("So far (8 of 9 trials are finished) `ppo` comes closest")
    assert second.startswith("On that evidence other methods do better")


@pytest.mark.parametrize(
    ("algo", "second"),
    [
        ("vpg", "is open: no other has finished trials in every cell"),
        ("ppo", "is open: `vpg` lacks finished trials in some cell"),
    ],
)
def test_alone(algo, second):
    found = sentences(*seeds(algo, MIDDLE))
    assert found[0].startswith(f"Only `{algo}` has finished trials in every cell")
    assert found[1].endswith(second)
