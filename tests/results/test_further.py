"""Further tables of the protocol: in sections of their own, never in an average with the grid."""

import json

import pytest
from made_tables import STEPS, made, seeds, trial

from usbench.agents import zoo
from usbench.figures import comparison, looks
from usbench.results import additions, leaderboard, provenance, scores, verdict
from usbench.results.protocol import further
from usbench.words import network_apart

ONE_FRAME = {"settings": '{"environment": "e", "gamma": 0.99, "n_frames": 1}', "configuration": "00000002"}
LONG = {"steps": 4 * STEPS, "configuration": "00000003"}


def named(kind, *rows):
    """Give trials of a further table names of their own, and the hyperparameters of their algorithms."""
    return [row | {"trial": f"{kind}-{row['trial']}", "settings": searched(row)} for row in rows]


def searched(row):
    known = zoo.ZOO[network_apart(row["algo"])[0]]
    own = known.hyperparameters | known.tasks.get(row["task"], {})
    return json.dumps(json.loads(row["settings"]) | own)


GRID = [
    *seeds("vpg", [0.5, 0.6, 0.55, 0.52, 0.58]),
    *seeds("ppo", [0.8, 0.85, 0.82, 0.81, 0.83]),
    *seeds("vpg", [0.5, 0.6, 0.55, 0.52, 0.58], noise=0.5),
    *seeds("ppo", [0.8, 0.85, 0.82, 0.81, 0.83], noise=0.5),
    trial("oracle", 1.0),
    trial("oracle", 1.0, noise=0.5),
]
SINGLE = named(
    "single",
    *seeds("vpg", [0.9, 0.95], **ONE_FRAME),
    *seeds("ppo", [0.1, 0.2], **ONE_FRAME),
    trial("oracle", 1.0, **ONE_FRAME),
)
SECOND = named("second", *seeds("vpg+residual", [0.3, 0.4]), *seeds("ppo+residual", [0.6, 0.7]))
FOUR = named("four", *seeds("vpg", [0.96, 0.97], **LONG))
ALL = made(*GRID, *SINGLE, *SECOND, *FOUR)


def test_trials_go_to_the_tables_of_their_settings_with_the_reference_policies():
    found = further.split(ALL)
    assert list(found) == ["grid", "single-frames", "second-network", "long"]
    assert set(found["grid"].trials["trial"]) == {row["trial"] for row in GRID}
    assert set(found["single-frames"].trials["trial"]) == {row["trial"] for row in SINGLE}
    oracle = {"fp-p0-oracle-s100"}
    assert set(found["second-network"].trials["trial"]) == {row["trial"] for row in SECOND} | oracle
    assert set(found["long"].trials["trial"]) == {row["trial"] for row in FOUR} | oracle
    assert all(set(own.curves["trial"]) == set(own.trials["trial"]) for own in found.values())


@pytest.mark.parametrize(
    "changes",
    [
        ONE_FRAME | {"noise": 0.5},
        ONE_FRAME | {"task": "exam", "steps": 32_128},
        ONE_FRAME | {"steps": 4 * STEPS},
        {"steps": 2 * STEPS},
        {"settings": '{"environment": "e", "n_frames": 2}'},
        {"algo": "vpg+another"},
    ],
)
def test_what_no_table_names_stays_beside_the_grid(changes):
    other = trial(**{"trial": "other", "configuration": "x", **changes})
    assert "other" in set(further.split(made(*GRID, other))["grid"].trials["trial"])


def test_one_table_alone_is_not_split():
    assert list(further.split(made(*SINGLE))) == ["single-frames"]
    assert list(further.split(made(*GRID))) == list(further.split(made())) == ["grid"]


def test_further_tables_without_the_grid_keep_their_names():
    assert list(scores.parts(made(*SINGLE, *FOUR))) == ["single-frames", "long"]


def test_nothing_of_the_grid_changes_by_further_tables():
    before, after = scores.cells(made(*GRID)), scores.cells(ALL)
    after = after[after["table"] == "grid"].reset_index(drop=True)
    assert before.equals(after)
    assert verdict.text(made(*GRID)) == verdict.text(ALL)
    one, two = (leaderboard.markdown(known).split("\n## ") for known in (made(*GRID), ALL))
    assert one[0] == two[0]
    last = ("How this was made", "Notes")
    assert [part for part in one if not part.startswith(last)] == [
        part
        for part in two
        if not part.startswith(last) and not any(name in part for name in further.names())
    ]


def test_further_tables_are_sections_of_the_leaderboard():
    text = leaderboard.markdown(ALL)
    headings = [line for line in text.splitlines() if line.startswith("## ")]
    assert "## Further table: single-frames" in headings and "## fp, noise 0: long" in headings
    assert len(headings) == len(set(headings))
    section = text.split("## Further table: single-frames\n\n")[1].split("\n## ")[0]
    assert section.startswith("As the grid, with 1 frame in one observation in place of 4; never averaged")
    agents = [line.split(" | ")[0] for line in section.splitlines() if line.startswith("| `")]
    assert agents == ["| `vpg`", "| `ppo`", "| `oracle` (not learned)"]
    # The grid's table explains the columns; those of further tables are brief.
    assert "primary figure" not in section and "resampled" not in section
    assert (
        "| agent | seeds | score (IQM) | with whole seeds | mean of the cells' IQMs | optimality gap |"
        in section
    )
    for name in ("single-frames", "second-network", "long"):
        assert f"\nusbench compare --table {name}\n" in text
    assert "configurations" not in text and "Training budgets" not in text


def test_commands_of_one_further_table():
    assert "```\nusbench compare --table single-frames\n```" in provenance.making(made(*SINGLE).trials)


def test_figures_of_further_tables_have_their_names_and_the_colours_of_the_grid():
    drawn = looks.agents(["ppo", "ppo+residual"])
    assert drawn["ppo+residual"]["color"] == drawn["ppo"]["color"]
    drawn = comparison.draw(ALL)
    assert drawn["second-network_scores"] is not None and drawn["long_improvement"] is None


def test_an_added_trial_of_a_further_table_is_in_no_row_of_the_grid():
    fresh = [row | {"seed": 100 + row["seed"]} for row in SINGLE if row["steps"]]
    assert additions.add(made(*GRID), made(*fresh)).apart == {}
