"""The first paragraph of a leaderboard: careful in every case."""

import re

import pandas as pd
import pytest
from made_tables import made, seeds, trial

from usbench.results import held_out, verdict

LOW = [0.50, 0.51, 0.52, 0.53, 0.54]
MIDDLE = [0.60, 0.65, 0.70, 0.75, 0.80]
HIGH = [0.90, 0.91, 0.92, 0.93, 0.94]
HERE = [
    "`fp` is evaluated on the phantom of training",
    "How agents do on others is not tested here",
]


def paragraphs(*trials):
    """Return the sentences of each paragraph."""
    return [said.removesuffix(".").split(". ") for said in verdict.sentences(made(*trials))]


def test_nothing_finished():
    assert paragraphs(trial("vpg", status="running"), trial("ppo", status="missing")) == [
        [
            "Whether other methods do better than the paper's vanilla policy gradient is open: no algorithm "
            "has finished trials in every cell",
            "0 of 2 trials are finished",
            "`usbench compare`, run again, adds the rest",
        ]
    ]


def test_no_trials_at_all():
    assert "0 of 0 trials are finished" in paragraphs()[0]


def test_where_all_is_finished_nothing_is_asked_for():
    """One agent in each cell: none is in both."""
    ((first, second),) = paragraphs(*seeds("vpg", LOW), *seeds("ppo", HIGH, task="pp"))
    assert first.endswith("is open: no agent can be compared over all cells")
    assert second == "All trials (10) are finished, but the cells hold different agents"


def test_without_a_seed_in_every_cell_this_is_the_reason():
    ((_, second),) = paragraphs(trial("vpg"), trial("vpg", task="pp", seed=101))
    assert second == "All trials (2) are finished, but no seed is finished in every cell"


def test_reference_policies_alone_answer_nothing():
    assert "is open" in paragraphs(trial("oracle", 1.0), trial("random", 0.0))[0][0]


def test_another_is_better():
    first, second, third = paragraphs(*seeds("vpg", MIDDLE), *seeds("ppo", HIGH), *seeds("a2c", LOW))
    assert first[0].startswith("`ppo` has the highest score: 0.92 [0.9")
    assert first[0].endswith(
        "over 1 of the 6 cells of the protocol (fp, noise 0) with 5 seeds, where 0 is the random agent and 1 "
        "the optimum"
    )
    assert first[1:] == ["`vpg` and `a2c` lie below `ppo`"]
    assert second[0] == "There, other methods do better than the paper's vanilla policy gradient, `vpg`"
    assert second[1].startswith("`vpg` has 0.70 [")
    assert second[2:] == [
        "`ppo` lies above `vpg`",
        "`a2c` lies below `vpg`",
        "A trial of `ppo` beats one of `vpg` with probability 1.00 [1.00, 1.00] (98.33 % interval, corrected "
        "for 3 pairs)",
    ]
    assert third == HERE


def test_its_own_is_best():
    first, second, _ = paragraphs(*seeds("vpg", HIGH), *seeds("ppo", LOW), *seeds("a2c", MIDDLE))
    assert first[0].startswith("`vpg` has the highest score")
    assert second[0] == "There, no other method does better than the paper's vanilla policy gradient, `vpg`"
    assert second[2:] == [
        "`a2c` and `ppo` lie below `vpg`",
        "A trial of `a2c` beats one of `vpg` with probability 0.00 [0.00, 0.00] (98.33 % interval, corrected "
        "for 3 pairs)",
    ]


def test_overlap_is_no_victory():
    first, second, _ = paragraphs(*seeds("vpg", MIDDLE), *seeds("ppo", [0.62, 0.66, 0.73, 0.78, 0.81]))
    assert re.match(r"`ppo` has the highest score: 0.72 \[[^]]*\] over 1 of", first[0])
    assert re.fullmatch(r"`vpg` has 0.70 \[[^]]*\] and cannot be told apart from `ppo`", first[1])
    assert len(first) == 2
    assert second[0].startswith("Whether other methods do better than")
    assert second[0].endswith("cannot be told from these seeds")
    assert second[2] == "`ppo` cannot be told apart from `vpg`"


def test_of_agents_that_cannot_be_told_apart_none_is_named_as_best():
    others = [*seeds("dqn", [0.895, 0.905, 0.92, 0.935, 0.945]), *seeds("a2c", [0.9, 0.92, 0.92, 0.93, 0.93])]
    first, *_ = paragraphs(*seeds("ppo", HIGH), *others, *seeds("vpg", LOW))
    best, near, last = re.findall(r"`(\w+)` has (?:the highest score: )?0.92", ". ".join(first))
    assert {best, near, last} == {"ppo", "dqn", "a2c"}
    assert all(said.endswith(f" and cannot be told apart from `{best}`") for said in first[1:3])
    assert first[3:] == [f"`vpg` lies below `{best}`"]


def test_a_first_look_names_those_whose_intervals_overlap_that_of_the_highest_score():
    low, high = seeds("vpg", LOW[:4]), seeds("ppo", HIGH[:4])
    found, _ = paragraphs(*low, *high, *seeds("a2c", [0.8, 0.9, 0.92, 0.94]))
    assert found[1].startswith("`ppo` has the highest score: 0.92 [")
    assert found[2] == "Its interval overlaps that of `a2c`"
    assert found[3].startswith("`vpg`, the paper's vanilla policy gradient, has 0.52 [")
    two = [*seeds("a2c", [0.8, 0.9, 0.92, 0.94]), *seeds("dqn", [0.7, 0.9, 0.92, 0.94])]
    assert "Its interval overlaps those of `a2c` and `dqn`" in paragraphs(*low, *high, *two)[0]
    assert "overlap" not in ". ".join(paragraphs(*low, *high)[0])


def test_the_rule_is_the_probability_of_improvement_not_the_intervals_of_the_scores():
    # Intervals of the two scores overlap; all but one of five trials beat all of the other's.
    trials = [*seeds("vpg", [0.1, 0.2, 0.3, 0.4, 0.5]), *seeds("ppo", [0.2, 0.55, 0.6, 0.65, 0.7])]
    first, *_ = paragraphs(*trials)
    assert first[1:] == ["`vpg` lies below `ppo`"]


def test_what_depends_on_whole_seeds_is_said():
    high, low = [0.9] * 7 + [0.1] * 3, [0.4 + 0.02 * number for number in range(10)]
    cells = [(task, noise) for task in ("fp", "pp") for noise in (0.0, 0.25, 0.5)]
    trials = [
        one
        for task, noise in cells
        for algo, own in (("vpg", low), ("ppo", high))
        for one in seeds(algo, own, task=task, noise=noise)
    ]
    found = paragraphs(*trials)
    assert "`ppo` lies above `vpg`" in found[1]
    assert found[2] == ["With whole seeds drawn, it is not sure that `ppo` lies above `vpg`"]


def test_equal_scores():
    _, second, _ = paragraphs(*seeds("vpg", MIDDLE), *seeds("ppo", MIDDLE))
    assert "cannot be told" in second[0] and "probability 0.50 [" in second[-1]
    assert second[-1].endswith("] (95 % interval)")


def test_tuned_vpg_is_no_other_method():
    first, second, third, _ = paragraphs(*seeds("vpg", LOW), *seeds("vpg-tuned", HIGH), *seeds("ppo", MIDDLE))
    assert first[0].startswith("`vpg-tuned` has the highest score")
    assert second[2] == "`ppo` lies above `vpg`"
    assert second[3].startswith("A trial of `ppo` beats one of `vpg`")
    assert third[0] == "`vpg-tuned` is the same algorithm, of which all settings were searched"
    assert third[1].startswith("It has 0.92 [")
    assert third[2:] == ["`vpg-tuned` lies above `vpg`", "`ppo` lies below `vpg-tuned`"]


@pytest.mark.parametrize("same", ["vpg-tuned", "vpg+residual"])
def test_the_same_algorithm_alone_makes_no_claim_for_others(same):
    _, second, *_ = paragraphs(*seeds("vpg", LOW), *seeds(same, HIGH))
    (only,) = second
    assert only.endswith("is open: no other has enough finished trials in every cell")


@pytest.mark.parametrize("n", [1, 2, 4])
def test_few_seeds_are_a_first_look(n):
    first, _ = paragraphs(*seeds("vpg", LOW[:n]), *seeds("ppo", HIGH[:n]))
    number = "1 seed" if n == 1 else f"{n} seeds"
    assert first[0] == f"A first look and no ranking: only {number}, where at least 5 are needed"
    assert first[1].startswith("`ppo` has the highest score: 0.9")
    assert " over 1 of the 6 cells of the protocol (fp, noise 0), where 0 is" in first[1]
    assert first[-1] == "Whether other methods do better than the paper's vanilla policy gradient is open"


def test_a_first_look_names_who_has_too_few_seeds():
    cut = [
        *seeds("vpg", LOW, steps=1024),
        *seeds("ppo", MIDDLE, steps=1024),
        *seeds("dqn", HIGH[:3], steps=1024),
    ]
    first, last, *_ = paragraphs(*cut)
    assert first[0].startswith("A first look and no ranking: training was cut short") and "`ppo`" in first[1]
    assert last == ["With only 3 seeds, where at least 5 are needed, `dqn` must wait"]


@pytest.mark.parametrize("seed", [7, 1000])
def test_seeds_that_settings_may_have_been_chosen_on_are_a_first_look(seed):
    trials = [*seeds("vpg", LOW), *seeds("ppo", HIGH), trial("ppo", 0.9, seed=seed)]
    first, *_ = paragraphs(*trials)
    assert first[0].endswith(f"no ranking: seed {seed} is not among those kept for comparisons (100 to 999)")
    assert first[-1].endswith("is open")


def test_all_cells_of_the_protocol_and_cells_beside_it_are_counted():
    whole = [(task, noise) for task in ("fp", "pp") for noise in (0.0, 0.25, 0.5)]
    for cells, words in (
        (whole, "over 6 cells with"),
        (whole[1:3], "over 2 of the 6 cells of the protocol (fp, noise 0.25; fp, noise 0.5) with"),
        ([("fp", 0.1)], "over the only cell with"),
        ([*whole, ("pp", 0.1)], "over 7 cells with"),
    ):
        trials = [one for task, noise in cells for one in seeds("vpg", LOW, task=task, noise=noise)]
        others = [one for task, noise in cells for one in seeds("ppo", HIGH, task=task, noise=noise)]
        first, second, _ = paragraphs(*trials, *others)
        assert words in first[0]
        assert second[0].startswith("There, other" if "of the 6" in words else "Other")


def test_a_further_table_alone_is_named():
    one_frame = {"settings": '{"environment": "e", "n_frames": 1}'}
    first, second, _ = paragraphs(*seeds("vpg", LOW, **one_frame), *seeds("ppo", HIGH, **one_frame))
    assert "over 1 cell of the further table single-frames (fp, noise 0) with 5 seeds" in first[0]
    assert second[0].startswith("There, other methods do better")


def test_a_short_budget_is_a_first_look():
    trials = [*seeds("vpg", LOW, steps=1024), *seeds("ppo", HIGH, steps=1024)]
    first, _ = paragraphs(*trials)
    assert first[0].endswith("training was cut short (1024 of 16064 steps on `fp`)")
    assert first[-1].endswith("is open")


def test_agents_with_few_seeds_beside_others_wait():
    text = verdict.text(
        made(*seeds("vpg", LOW), *seeds("ppo", HIGH), *seeds("a2c", [1.0] * 4), trial("trpo"))
    )
    assert text.startswith("`ppo` has the highest score of those with at least 5 seeds: 0.92")
    assert "With only 1 to 4 seeds, where at least 5 are needed, `a2c` and `trpo` must wait." in text
    assert text.count("a2c") == 1


def test_missing_trials_are_said():
    first, second, _ = paragraphs(
        *seeds("vpg", LOW),
        *seeds("ppo", HIGH),
        trial("ppo", seed=105, status="missing"),
        trial("oracle", 1.0),
    )
    assert first[0] == "So far 10 of 11 trials are finished"
    assert first[1].startswith("`ppo` has the highest score")
    assert second[0].startswith("There, other methods do better")


@pytest.mark.parametrize(
    ("algo", "second"),
    [
        ("vpg", "is open: no other has enough finished trials in every cell"),
        ("ppo", "is open: `vpg` lacks finished trials in some cell, or seeds"),
    ],
)
def test_alone(algo, second):
    found = paragraphs(*seeds(algo, MIDDLE))
    assert found[0][0] == f"Only `{algo}` has enough finished trials in every cell"
    assert found[0][1].startswith("It has 0.70 [")
    assert found[1][0].endswith(second)


def on_unseen(*trials):
    """Return tests on unseen phantoms, of 0.3 for `vpg` and 0.1 for others."""
    rows = [
        [one["trial"], f"{one['task']}-random", 8, 0.3 if one["algo"] == "vpg" else 0.1, -18.0, 0.0]
        for one in trials
    ]
    return pd.DataFrame(rows, columns=list(held_out.COLUMNS))


def of_unseen(trials, rows):
    """Return the sentences on unseen phantoms."""
    last = verdict.sentences(made(*trials), rows)[-1]
    return last.removesuffix(".").split(". ")


def test_scores_on_phantoms_never_seen_stand_in_the_last_paragraph():
    trials = [
        *seeds("vpg", LOW),
        *seeds("ppo", HIGH),
        *seeds("vpg", LOW, task="pp"),
        *seeds("ppo", HIGH, task="pp"),
    ]
    ends = "As far as intervals tell, the lowest there is `ppo`, and the highest is `vpg`"
    assert of_unseen(trials, on_unseen(*trials)) == [
        "`fp` and `pp` are evaluated on the phantom of training",
        "Agents were tested on unseen phantoms, too",
        "Agents with 0.52 to 0.92 on `fp` have 0.10 to 0.30 on unseen phantoms",
        ends,
        "Agents with 0.52 to 0.92 on `pp` have 0.10 to 0.30 on unseen phantoms",
        ends,
    ]


def test_scores_on_phantoms_never_seen_are_those_of_all_noises_together():
    trials = [one for noise in (0.0, 0.5) for one in seeds("vpg", LOW, noise=noise)]
    said = of_unseen(trials, on_unseen(*trials))
    assert said[1].endswith("on unseen phantoms, too; the tested noises are taken together")
    assert said[2].startswith("Agents with 0.52 to 0.52 on `fp` have ")


def test_noises_of_one_task_each_are_not_taken_together():
    trials = [*seeds("vpg", LOW, noise=0.5), *seeds("vpg", LOW, task="pp")]
    assert of_unseen(trials, on_unseen(*trials))[1].endswith("on unseen phantoms, too")


def test_on_phantoms_never_seen_all_are_named_whose_intervals_overlap_an_end():
    trials = [*seeds("vpg", LOW), *seeds("ppo", HIGH), *seeds("a2c", MIDDLE)]
    rows = on_unseen(*trials)
    spread = rows["trial"].str.contains("a2c")
    near_ppo = rows.assign(
        normalized_score=rows["normalized_score"].where(~spread, [0.05, 0.1, 0.12, 0.1, 0.15] * 3)
    )
    assert of_unseen(trials, near_ppo)[2:] == [
        "Agents with 0.52 to 0.92 on `fp` have 0.10 to 0.30 on unseen phantoms",
        "As far as intervals tell, the lowest there are `a2c` and `ppo`, and the highest is `vpg`",
    ]
    over_all = rows.assign(
        normalized_score=rows["normalized_score"].where(~spread, [0.0, 0.0, 0.2, 0.4, 0.4] * 3)
    )
    assert of_unseen(trials, over_all)[2:] == [
        "Agents with 0.52 to 0.92 on `fp` have 0.10 to 0.30 on unseen phantoms",
        "Their intervals there overlap",
    ]


def test_where_nobody_is_above_the_random_agent_on_phantoms_never_seen_nobody_is_the_highest():
    trials = [*seeds("vpg", LOW), *seeds("ppo", HIGH)]
    rows = on_unseen(*trials)
    rows["normalized_score"] -= 0.5
    assert of_unseen(trials, rows)[3] == "No score there is above that of the random agent"


def test_scores_on_phantoms_never_seen_name_the_noise_where_not_all_was_tested():
    quiet = [*seeds("vpg", LOW), *seeds("ppo", HIGH)]
    noisy = [*seeds("vpg", LOW, noise=0.5), *seeds("ppo", HIGH, noise=0.5)]
    trials = [*quiet, *noisy]
    said = of_unseen(trials, on_unseen(*noisy))
    assert said[2] == "Agents with 0.52 to 0.92 on `fp` (noise 0.5) have 0.10 to 0.30 on unseen phantoms"
    assert "(noise" not in ". ".join(of_unseen(trials, on_unseen(*quiet, *noisy)))
