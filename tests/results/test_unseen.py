"""The table of unseen phantoms: what is of it, what its rows tell, and that the grid stays."""

import json

import pytest
from made_tables import STEPS, made, seeds, trial

from usbench.agents import zoo
from usbench.ceilings import ceiling
from usbench.figures import comparison
from usbench.results import leaderboard, provenance, scores, verdict
from usbench.results.protocol import further, unseen


def told(task, algo="double_dqn", score=0.8, senses="", n_frames=4, **changes):
    """Return a trial of the table; its settings name it."""
    settings = {"environment": "e", **zoo.hyperparameters(algo, task), "n_envs": 32, "n_frames": n_frames}
    text = json.dumps(settings | ({"senses": senses} if senses else {}))
    name = f"{task}-{algo}-{senses}-{n_frames}-{changes.get('seed', 100)}"
    row = {"steps": unseen.STEPS, "seed": 100, "settings": text, "trial": name, "configuration": name[:-4]}
    return trial(algo, score, task=task, **{**row, **changes})


GRID = [
    *seeds("vpg", [0.5, 0.6, 0.55, 0.52, 0.58]),
    *seeds("ppo", [0.8, 0.85, 0.82, 0.81, 0.83]),
    *seeds("dqn", [0.4, 0.5], task="exam", steps=32_128),
    *seeds("dqn", [0.8, 0.9], task="fp-random"),
    *seeds("dqn", [0.1, 0.2], task="pp-random"),
    *(trial("oracle", 1.0, task=task) for task in ("fp", "exam", "fp-random", "pp-random")),
]
OWN = [
    told("fp-random", score=0.98),
    told("pp-random", score=0.84, senses="actions"),
    told("pp-tracked", score=0.9, senses="position heading", n_frames=2),
    told("pp-tracked", "distilled", 0.95, senses="heading actions", configuration="d"),
]
TRACKED = trial("oracle", 1.0, task="pp-tracked")
ALL = made(*GRID, *OWN, TRACKED)


def row_of(text, cell, agent):
    """Return the words of an agent's row by the columns of a cell's table."""
    lines = text.split(f"## {cell}: {unseen.NAME}\n")[1].split("\n## ")[0].splitlines()
    (head,) = [line for line in lines if line.startswith("| agent |")]
    (row,) = [line for line in lines if line.startswith(f"| `{agent}`")]
    return dict(zip(head.strip("| ").split(" | "), row.strip("| ").split(" | "), strict=True))


@pytest.mark.parametrize(
    ("task", "steps", "wanted"),
    [
        ("pp-tracked", 100_000, True),
        ("exam-random", 64, True),
        ("exam-tracked", 0, True),
        ("fp-random", 100_000, True),
        ("pp-random", 50_000, True),
        ("fp-random", STEPS, False),
        ("pp-random", 64, False),
        ("fp-random", 0, False),
        ("pp", 100_000, False),
        ("exam", 100_000, False),
    ],
)
def test_budget_and_task_decide_what_is_of_the_table(task, steps, wanted):
    assert unseen.has(task, steps) is wanted


def test_trials_stand_beside_the_reference_policies_of_their_cells():
    found = further.split(ALL)
    assert list(found) == [further.GRID, unseen.NAME]
    beside = {"fp-random-p0-oracle-s100", "pp-random-p0-oracle-s100", TRACKED["trial"]}
    assert set(found[unseen.NAME].trials["trial"]) == {row["trial"] for row in OWN} | beside
    assert set(found[further.GRID].trials["trial"]) == {row["trial"] for row in GRID}


def test_reference_policies_alone_make_no_cell_of_the_grid():
    assert set(further.split(made(*GRID, TRACKED))[further.GRID].trials["trial"]) == {
        row["trial"] for row in GRID
    }


def test_reference_policies_leave_a_cell_in_which_the_table_alone_has_learners():
    without = [row for row in GRID if row["task"] != "fp-random"]
    references = [trial("oracle", 1.0, task="fp-random"), trial("oracle", 1.0, task="fp", noise=0.5)]
    found = further.split(made(*without, *references, *OWN))
    assert references[0]["trial"] in set(found[unseen.NAME].trials["trial"])
    # At noise 0.5 nobody has learned anywhere yet.
    assert set(found[further.GRID].trials["trial"]) == {row["trial"] for row in (*without, references[1])}


def test_nothing_of_the_grid_changes_by_the_table():
    before, after = scores.cells(made(*GRID)), scores.cells(ALL)
    assert before.equals(after[after["table"] == further.GRID].reset_index(drop=True))
    assert set(before.loc[before["task"] == "exam", "seeds_asked"]) == {1, 2}
    assert verdict.text(made(*GRID)) == verdict.text(ALL)


def test_seeds_asked_are_counted_within_the_table():
    rows = scores.cells(ALL)
    assert set(rows.loc[rows["table"] == unseen.NAME, "seeds_asked"]) == {1}


def test_rows_tell_steps_frames_what_is_told_and_its_ceiling():
    text = leaderboard.markdown(ALL)
    row = row_of(text, "pp-random, noise 0", "double_dqn")
    assert row["learned with"] == "told actions; 4 frames; 100000 steps"
    assert row["ceiling"] == f"{ceiling('pp-random'):.3f}"
    row = row_of(text, "pp-tracked, noise 0", "double_dqn")
    assert row["learned with"] == "told position, heading; 2 frames; 100000 steps"
    assert row["ceiling"] == f"{ceiling('pp-tracked', ['position', 'heading']):.3f}"
    # Another ceiling in the same cell, of what this agent is told.
    row = row_of(text, "pp-tracked, noise 0", "distilled")
    assert row["agent"] == "`distilled` (practical ceiling, not ranked)"
    assert row["learned with"].startswith("told heading, actions; 4 frames")
    assert row["ceiling"] == f"{ceiling('pp-tracked', ['heading']):.3f}"
    told_nothing = row_of(text, "fp-random, noise 0", "double_dqn")
    assert told_nothing["learned with"].startswith("told nothing; ")
    row = row_of(text, "fp-random, noise 0", "oracle")
    assert {row[name] for name in unseen.COLUMNS} == {"–"}
    # As many columns as the grid's tables have.
    assert list(row) == ["agent", "seeds", "score, greedy", "success (%)", *unseen.COLUMNS]


def test_only_this_table_has_its_columns():
    text = leaderboard.markdown(ALL)
    of_grid = text.split("## fp-random, noise 0\n")[1].split("\n## ")[0]
    assert not set(unseen.COLUMNS) & set(of_grid.split("\n| agent | ")[1].splitlines()[0].split(" | "))


def test_agents_that_are_told_other_things_stand_in_one_cell():
    known = made(*(told("pp-tracked", senses=senses) for senses in ("heading", "position")))
    assert set(scores.matrices(known)[0]) == {
        "double_dqn senses=heading",
        "double_dqn senses=position",
    }
    assert not any("different environments" in note for note in provenance.notes(known.trials))


def test_section_tells_what_the_table_is_where_agents_share_no_cell():
    known = made(*GRID, told("pp-random", "ppo_asymmetric"), told("fp-random"))
    section = leaderboard.markdown(known).split(f"## Further table: {unseen.NAME}\n\n")[1].split("\n## ")[0]
    assert section == f"{unseen.ABOUT}\n"


def test_commands_say_what_differs_from_the_defaults():
    lines = joined(provenance.making(ALL.trials)).split("```")[1].splitlines()
    assert "usbench run --algo double_dqn --task fp-random --steps 100000 --seed 100" in lines
    assert (
        "usbench run --algo double_dqn --task pp-random --steps 100000 --senses actions --seed 100" in lines
    )
    assert "usbench run --algo double_dqn --task pp-tracked --steps 100000 --n-frames 2 --seed 100" in lines
    several = made(*(told("pp-tracked", senses="heading", noise=0.25, seed=seed) for seed in (100, 101)))
    command = "usbench run --algo double_dqn --task pp-tracked --steps 100000 --noise 0.25 --senses heading"
    made_by = joined(provenance.making(several.trials))
    assert f"for seed in 100 101; do {command} --seed $seed; done" in made_by


def test_commands_say_which_hyperparameters_are_not_the_defaults():
    lines = joined(provenance.making(made(told("pp-tracked"), changed(gamma=0.5, max_shift_px=2)).trials))
    command = "usbench run --algo double_dqn --task pp-tracked --steps 100000 --senses"
    assert f"{command} --seed 100" in lines
    assert f"{command} --set gamma=0.5 max_shift_px=2 --seed 100" in lines
    lines = joined(provenance.making(made(told("pp-tracked"), changed(greedy_shift_px=2)).trials))
    assert f"{command} --seed 100" in lines and f"{command} --set greedy_shift_px=2 --seed 100" in lines


@pytest.mark.parametrize("settings", [{"n_envs": 1}, {"gamma": None}])
def test_no_command_is_told_that_would_make_other_trials(settings):
    assert "usbench run" in provenance.making(made(changed()).trials)
    assert "usbench run" not in provenance.making(made(changed(**settings)).trials)


def changed(**settings):
    """Return the row of a trial with other settings."""
    own = told("pp-tracked")
    return own | {"settings": json.dumps(json.loads(own["settings"]) | settings)}


def joined(text):
    """Return commands as the shell reads them."""
    return text.replace(" \\\n    ", " ")


def test_figures_of_the_table_are_scores_and_learning_curves():
    drawn = comparison.draw(ALL)
    kinds = ("scores", "learning_curves", "learning_curves_cpu")
    assert [name for name in drawn if name.startswith(unseen.NAME)] == [
        f"{unseen.NAME}_{kind}" for kind in kinds
    ]


def test_frames_are_compared_over_all_tables_and_what_is_said_of_all_is_said_once():
    differing = [told("pp-tracked", seed=seed, frames=str(seed)) for seed in (100, 101)]
    of_grid = [trial("vpg", seed=seed, task="pp", frames=str(seed)) for seed in (100, 101)]
    known = made(*GRID, *of_grid, *differing)
    text = leaderboard.markdown(known)
    assert "\n* Frames of pp-tracked differ between trials: 2 kinds" in text
    assert text.count("kind of processor") == 1
