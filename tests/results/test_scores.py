"""Cells and matrices from rows of trials."""

import json

import numpy as np
import pandas as pd
import pytest
from made_tables import made, seeds, trial

from usbench.results import collecting, scores
from usbench.trials import runner
from usbench.trials.configuration import resolve


def cell(known, **names):
    rows = scores.cells(known)
    for column, value in names.items():
        rows = rows[rows[column] == value]
    assert len(rows) == 1
    return rows.iloc[0]


def test_cell_by_hand():
    row = cell(made(*seeds("vpg", [0.2, 0.4, 0.6, 1.0])), actions="greedy")
    # The middle two of four seeds.
    assert row["score"] == pytest.approx(0.5)
    assert 0.2 <= row["score_low"] < 0.5 < row["score_high"] <= 1.0
    assert row["normalized_score"] == pytest.approx(0.55)
    assert row["return"] == pytest.approx(-21 + 16 * 0.55)
    assert (row["seeds"], row["seeds_asked"]) == (4, 4)
    # From 0 through half the score to the score, evenly spaced: half of it.
    assert row["area_under_curve"] == pytest.approx(0.55 / 2)
    assert row["training_minutes"] == 2.0


def test_drawn_actions_have_a_row_of_their_own():
    row = cell(made(*seeds("vpg", [0.4, 0.6])), actions="drawn")
    assert row["score"] == pytest.approx(0.4)


def test_single_seed_has_no_interval():
    row = cell(made(trial("vpg", 0.4)), actions="greedy")
    assert row["score"] == 0.4 and np.isnan(row["score_low"]) and np.isnan(row["score_high"])


def test_unfinished_trials_are_counted_and_never_averaged():
    known = made(*seeds("vpg", [0.2, 0.4]), trial("vpg", 0.9, seed=2, status="failed"))
    row = cell(known, actions="greedy")
    assert (row["seeds"], row["seeds_asked"]) == (2, 3)
    assert row["normalized_score"] == pytest.approx(0.3)


def test_cell_without_a_finished_trial_is_a_row_of_nan():
    row = cell(made(trial("vpg", status="running")), actions="greedy")
    assert row["seeds"] == 0 and np.isnan(row["score"]) and np.isnan(row["training_minutes"])


def test_seeds_asked_are_those_of_all_learners_but_not_for_what_does_not_learn():
    known = made(*seeds("vpg", [0.2, 0.4, 0.6]), *seeds("a2c", [0.5]), trial("oracle", 1.0))
    assert cell(known, algo="a2c", actions="greedy")["seeds_asked"] == 3
    assert cell(known, algo="oracle", actions="greedy")["seeds_asked"] == 1


def test_configurations_are_never_mixed():
    other = trial("vpg", 0.9, seed=1, trial="other", configuration="00000002")
    known = made(trial("vpg", 0.1), other)
    assert list(scores.cells(known).query("actions == 'greedy'")["score"]) == [0.1, 0.9]
    other["settings"] = '{"environment": "e", "gamma": 0.9}'
    found, _ = scores.matrices(made(trial("vpg", 0.1), other))
    assert {agent: matrix.tolist() for agent, matrix in found.items()} == {
        "vpg gamma=0.99": [[0.1]],
        "vpg gamma=0.9": [[0.9]],
    }


def test_row_does_not_change_when_another_agent_is_added():
    alone = scores.cells(made(*seeds("vpg", [0.2, 0.4, 0.7])))
    both = scores.cells(made(*seeds("vpg", [0.2, 0.4, 0.7]), *seeds("a2c", [0.1, 0.3, 0.9])))
    pd.testing.assert_frame_equal(both[both["algo"] == "vpg"].reset_index(drop=True), alone)


def test_matrix_has_the_seeds_that_are_finished_everywhere():
    known = made(
        *seeds("vpg", [0.1, 0.2, 0.3]),
        *seeds("vpg", [0.4, 0.5], task="pp"),
        *seeds("a2c", [0.6]),
        *seeds("dqn", [0.7, 0.8]),
        trial("dqn", 0.9, task="pp", seed=5),
    )
    found, reasons = scores.matrices(known)
    assert list(found) == ["vpg"]
    assert found["vpg"].tolist() == [[0.1, 0.4], [0.2, 0.5]]
    assert reasons == {
        "a2c": "no finished trial in pp, noise 0",
        "dqn": "no seed is finished in every cell",
    }


def test_only_what_learns_is_among_the_learners():
    known = made(trial("vpg"), trial("oracle", 1.0), trial("random", 0.0))
    assert list(scores.matrices(known)[0]) == ["oracle", "random", "vpg"]
    assert list(scores.learners(known)) == ["vpg"]


def test_papers_tasks_are_averaged_apart_from_others():
    exam = seeds("vpg", [0.1], task="exam")
    known = made(*seeds("vpg", [0.5, 0.7]), *seeds("a2c", [0.6]), *exam, trial("oracle", 1.0, task="exam"))
    parts = scores.parts(known)
    assert list(parts) == [scores.PAPERS, scores.OTHERS]
    assert scores.matrices(parts[scores.PAPERS])[0]["vpg"].tolist() == [[0.5], [0.7]]
    assert scores.matrices(parts[scores.PAPERS])[0]["a2c"].tolist() == [[0.6]]
    assert set(scores.matrices(parts[scores.OTHERS])[0]) == {"oracle", "vpg"}
    for own in parts.values():
        assert set(own.curves["trial"]) == set(own.trials["trial"])


@pytest.mark.parametrize("task", ["fp", "exam"])
def test_tasks_of_one_kind_are_averaged_together(task):
    # That agents which do not learn were on another task makes no second kind.
    known = made(trial("vpg", task=task), trial("oracle", task="setup"))
    assert scores.parts(known) == {scores.ALL: known}


def test_nothing_is_averaged_over_different_environments():
    mine = trial("a2c", 0.9, settings='{"environment": "mine"}')
    found, reasons = scores.matrices(made(trial("vpg"), mine))
    assert not found
    assert reasons == dict.fromkeys(("a2c", "vpg"), "trials of fp, noise 0 are from different environments")


@pytest.mark.parametrize("setting", ['"exploration_final_eps": 0.05', '"explores": true'])
def test_value_based_agents_have_no_score_with_sampled_actions(setting):
    text = '{"environment": "e", "note": "\\"exploration_final_eps\\""}'
    explores = {"settings": f'{{"environment": "e", {setting}}}'}
    known = made(trial("vpg", 0.5, settings=text), trial("dqn", 0.9, **explores))
    assert cell(known, algo="vpg", actions="drawn")["score"] == pytest.approx(0.4)
    assert np.isnan(cell(known, algo="dqn", actions="drawn")["score"])
    assert cell(known, algo="dqn", actions="greedy")["score"] == 0.9


def test_value_based_agents_from_outside_have_no_score_with_sampled_actions(quick, tmp_path):
    # The hyperparameters of a bare class are none of the table's.
    algos = {"stable_baselines3:DQN": {}, "stable_baselines3:A2C": {}, "dqn": {"buffer_size": 64}}
    for algo, overrides in algos.items():
        runner.run_trial(resolve(algo, "pp", steps=64, overrides=overrides), tmp_path / "runs")
    known = collecting.collect(tmp_path / "runs")
    told = {row.algo: "explores" in json.loads(row.settings) for row in known.trials.itertuples()}
    # The settings of "dqn" tell already, and stay as they always were.
    assert [told[algo] for algo in algos] == [True, False, False]
    sampled = scores.cells(known).query("actions == 'drawn'").set_index("algo")["score"]
    assert [bool(np.isnan(sampled[algo])) for algo in algos] == [True, False, True]


def test_area_is_over_the_steps_that_an_agent_had_learned_from():
    known = made(trial("vpg", 0.8))
    # From 0 over 0.4 to 0.8; a long rollout moves the checkpoint in the middle to three quarters.
    assert cell(known, actions="greedy")["area_under_curve"] == pytest.approx(0.4)
    middle = (known.curves["kind"] == "greedy") & (known.curves["step"] == 8032)
    known.curves.loc[middle, "trained"] = 12_048
    assert cell(known, actions="greedy")["area_under_curve"] == pytest.approx(0.75 * 0.2 + 0.25 * 0.6)


def test_learning_curves_hold_every_checkpoint_of_what_learns():
    table = scores.learning_curves(made(*seeds("vpg", [0.4, 0.8]), trial("oracle", 1.0)))
    assert list(table["agent"].unique()) == ["vpg"]
    assert list(table["step"]) == [0, 8032, 16064]
    assert list(table["minutes"]) == [0, 1, 2]
    assert list(table["score"]) == pytest.approx([0.0, 0.3, 0.6])


def test_no_results_are_empty_tables():
    empty = made()
    assert scores.cells(empty).empty and scores.learning_curves(empty).empty
    assert scores.matrices(empty) == ({}, {})
