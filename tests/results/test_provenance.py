"""Where results come from, and what a reader has to know."""

import json

import pytest
from made_tables import made, seeds, trial

from usbench.agents.zoo import ZOO
from usbench.results import agents, provenance


def usual(algo="vpg", score=0.5, *, of="", **changes):
    """Return the row of a trial as the table of algorithms has it, but for the settings in `of`."""
    row = ZOO[algo]
    own = row.hyperparameters | row.tasks.get(changes.get("task", "fp"), {})
    settings = {"environment": "e", **own, **dict(of)}
    return trial(algo, score, **{"settings": json.dumps(settings), **changes})


def grid(**changes):
    return [
        usual(algo, task=task, noise=noise, seed=seed, **changes)
        for algo in ("vpg", "a2c")
        for task in ("pp", "fp")
        for noise in (0.0, 0.25)
        for seed in (100, 101)
    ]


def notes(*trials):
    return provenance.notes(made(*trials).trials)


def test_whole_grid_is_one_command():
    trials = made(*grid(), trial("oracle", 1.0)).trials
    expected = "usbench compare --algos a2c vpg --tasks fp pp --noise 0 0.25 --seeds 2"
    assert provenance.commands(trials) == [expected]
    assert f"```\n{expected}\n```" in provenance.making(trials)


def test_budget_that_is_not_the_tasks_is_named():
    assert provenance.commands(made(*grid(steps=64)).trials)[0].endswith("--seeds 2 --steps 64")


def test_what_several_comparisons_made_names_each():
    exam = [usual(algo, task="exam", steps=32_128) for algo in ("vpg", "a2c")]
    trials = made(*grid(), *exam, usual("dqn", task="pp")).trials
    expected = [
        "usbench compare --algos a2c vpg --tasks exam --noise 0 --seeds 1",
        "usbench compare --algos a2c vpg --tasks fp pp --noise 0 0.25 --seeds 2",
        "usbench compare --algos dqn --tasks pp --noise 0 --seeds 1",
    ]
    assert sorted(provenance.commands(trials)) == expected
    assert "usbench leaderboard --runs runs\n```" in provenance.making(trials)
    # A budget belongs to a task: nothing is unusual about two.
    assert not any("budget" in note for note in provenance.notes(trials))


def test_command_counts_seeds_from_the_first_of_comparisons():
    trials = made(*(usual(seed=seed) for seed in (100, 101, 102))).trials
    assert provenance.commands(trials) == ["usbench compare --algos vpg --tasks fp --noise 0 --seeds 3"]


@pytest.mark.parametrize(
    "trials",
    [
        [usual("vpg", seed=seed) for seed in (100, 102)],
        [usual("vpg", seed=seed) for seed in (101, 102)],
        [usual("vpg", seed=seed) for seed in (0, 1)],
        [usual("vpg"), usual("vpg", noise=0.5), usual("vpg", noise=0.5, seed=101)],
        [usual("vpg"), usual("vpg", configuration="00000002")],
        [usual(of={"gamma": 0.5})],
        [usual(of={"n_envs": 16})],
        [usual(of={"senses": "heading"})],
        [trial("oracle")],
        [],
    ],
    ids=[
        "hole",
        "later",
        "earlier version",
        "cells",
        "configurations",
        "settings",
        "environments",
        "senses",
        "no learner",
        "nothing",
    ],
)
def test_what_no_comparisons_make_names_none(trials):
    assert provenance.commands(made(*trials).trials) == []


def test_what_no_comparison_makes_is_told_trial_by_trial():
    """Seeds that are not the first of their pool, at a noise, beside a comparison."""
    later = [usual(task="pp", noise=0.25, seed=seed, steps=64) for seed in (110, 111)]
    compared = [usual("a2c", seed=seed) for seed in (100, 101)]
    said = provenance.making(made(*later, *compared, trial("oracle", 1.0)).trials)
    commands = said.split("```")[1].replace(" \\\n    ", " ").strip().splitlines()
    assert commands == [
        "usbench compare --algos a2c --tasks fp --noise 0 --seeds 2",
        "for seed in 110 111; do usbench run --algo vpg --task pp --steps 64 --noise 0.25 --seed $seed; done",
        "usbench leaderboard --runs runs",
    ]


def test_a_trial_with_another_budget_leaves_the_command_of_those_with_the_tasks_own():
    """It is a row of its own, whatever its configuration is called."""
    trials = made(usual("vpg"), usual("vpg", seed=101, steps=32)).trials
    assert set(agents.named(trials)["agent"]) == {"vpg", "vpg steps=32"}
    assert provenance.commands(trials) == ["usbench compare --algos vpg --tasks fp --noise 0 --seeds 1"]


def test_a_trial_with_other_settings_leaves_the_commands_of_the_others():
    other = trial(settings='{"environment": "e", "gamma": 0.9}', configuration="00000002")
    expected = ["usbench compare --algos a2c vpg --tasks fp pp --noise 0 0.25 --seeds 2"]
    assert provenance.commands(made(*grid(), other).trials) == expected


def test_different_environments_are_said():
    mine = trial("a2c", settings='{"environment": "mine", "gamma": 0.99}')
    (note,) = notes(trial("vpg"), mine)
    assert note == (
        "Trials on fp, noise 0 are from different environments (their digests): vpg in e; a2c in mine. "
        "Their scores cannot be compared."
    )


def test_hours_are_those_of_finished_trials():
    trials = made(*seeds("vpg", [0.5] * 30), trial("vpg", seed=130, status="failed")).trials
    assert "30 of 31 trials are finished" in provenance.making(trials)
    assert "1.50 hours on one core, 1.00 of them training" in provenance.making(trials)
    assert "Versions: numpy 2.0, torch 2.5." in provenance.making(trials)
    assert "9.0 minutes on one core, 6.0 of them training" in provenance.making(trials[:3])


def test_nothing_unusual_needs_no_note():
    assert notes(*grid(), trial("random", 0.0)) == []


def test_unfinished_trials_are_named_with_their_reason():
    found = notes(
        trial("vpg"),
        trial("vpg", seed=101, status="missing"),
        trial("vpg", seed=102, status="failed", reason="OSError: disk\nfull"),
        trial("vpg", seed=103, status="interrupted"),
        trial("vpg", seed=104, status="running"),
    )
    assert found == [
        "`vpg` on fp, noise 0: seed 101 has not been run, seed 102 failed (OSError: disk full), "
        "seed 103 was interrupted, seed 104 is running or was killed."
    ]


def test_the_reason_of_a_trial_is_no_markup():
    (found,) = notes(trial("vpg", status="failed", reason="got *this*, <script>alert(1)</script>"))
    assert not set("*<>") & set(found)


def test_configurations_are_told_apart_by_what_differs():
    other = {"configuration": "00000002", "settings": '{"environment": "e", "gamma": 0.9}'}
    note, _ = notes(trial("vpg"), trial("vpg", seed=101), trial("vpg", **other))
    assert "in 2 configurations" in note
    assert "`vpg` has gamma=0.99; `vpg gamma=0.9` has gamma=0.9." in note


def test_what_a_trial_has_recorded_is_no_markup():
    wild = "*a* <img src=x>\n## forged [b](c)"
    other = {"configuration": "00000002", "settings": json.dumps({"environment": "e", "gamma": wild})}
    stranger = trial("vpg", seed=101, task="pp", steps=99, settings=other["settings"])
    mine = trial(f"{wild}:Mine", task="pp", seed=102)
    found = notes(trial("vpg"), trial("vpg", **other), stranger, mine)
    assert any("in 2 configurations" in note for note in found)
    assert any("Training budgets on pp differ" in note for note in found)
    assert any("Seeds differ on pp" in note for note in found)
    found += notes(stranger)
    assert "has other settings than" in found[-1]
    assert not [note for note in found if set("*[\n") & set(note) or "<img" in note]


def test_settings_that_are_not_those_of_the_table_and_stand_in_no_name_are_said():
    long = {"n_steps": 64}
    small = usual("a2c", noise=0.25, of=long | {"learning_rate": 0.0001}, configuration="00000002")
    assert notes(usual("a2c", of=long), small) == [
        "`a2c learning_rate=0.0001` has other settings than `usbench list a2c` shows: "
        "learning_rate=0.0001, n_steps=64.",
        "`a2c learning_rate=3.48e-05` has other settings than `usbench list a2c` shows: n_steps=64.",
    ]
    assert notes(usual("a2c", of=long)) == [
        "`a2c` has other settings than `usbench list a2c` shows: n_steps=64."
    ]
    # Here the name says all.
    (note,) = notes(usual("a2c"), usual("a2c", of=long, configuration="00000002"))
    assert note.startswith("`a2c` on fp, noise 0 ran in 2 configurations")


def test_different_budgets_and_seeds_are_said():
    assert notes(trial("vpg"), trial("a2c", seed=101, steps=320)) == [
        "Training budgets on fp differ: 320 steps for a2c; 16064 steps for vpg.",
        "Seeds differ on fp, noise 0: 100 for vpg; 101 for a2c.",
    ]


def test_different_versions_and_frames_are_said():
    trials = seeds("vpg", [0.5] * 3) + [
        trial("vpg", seed=103, versions="numpy 2.0, torch 2.4", frames="def"),
        trial("vpg", task="pp", seed=103, frames="other task"),
    ]
    *found, why = provenance.origins(made(*trials).trials)
    assert found == [
        "Versions of torch differ between trials: 2.5 in 4, 2.4 in 1 (`fp-p0-vpg-s103`).",
        "Frames of fp differ between trials: 2 kinds, in 3 + 1 trials (`frames` in `trials.csv`).",
    ]
    assert "kind of processor" in why


def test_version_that_only_some_recorded_is_said():
    trials = [*seeds("vpg", [0.5] * 2), trial("vpg", seed=102, versions="")]
    assert (
        "Versions of torch differ between trials: 2.5 in 2, not recorded in 1 (`fp-p0-vpg-s102`)."
        in provenance.origins(made(*trials).trials)
    )


def test_seeds_that_are_not_kept_for_comparisons_are_said():
    trials = [trial("vpg", seed=seed) for seed in (0, 1000, 100)] + [trial("oracle", seed=5)]
    assert provenance.notes(made(*trials).trials) == [
        "These seeds are not kept for comparisons, as 100 to 999 are, so that settings may have been chosen "
        "on them: 0, 1000."
    ]


def test_noise_stands_in_a_command_with_all_its_digits():
    (command,) = provenance.commands(made(usual(noise=1 / 3)).trials)
    assert float(command.split("--noise ")[1].split()[0]) == 1 / 3


@pytest.mark.parametrize(
    ("changes", "command"),
    [
        ({}, "usbench compare --table long"),
        ({"seed": 103}, "usbench run --algo vpg --task fp --steps 64256 --seed 103"),
        ({"of": {"gamma": 0.9}}, "usbench run --algo vpg --task fp --steps 64256 --set gamma=0.9 --seed 100"),
        (
            {"algo": "ppo_asymmetric", "of": {"n_envs": 16}},
            "usbench run --algo ppo_asymmetric --task fp --steps 64256 --seed 100",
        ),
    ],
)
def test_the_comparison_of_a_table_is_named_where_it_makes_the_trials(changes, command):
    """The table long has three seeds, and four times the budget."""
    told = provenance.making(made(usual(steps=64_256, **changes)).trials).replace("\\\n    ", "")
    assert f"```\n{command}\n```" in told
