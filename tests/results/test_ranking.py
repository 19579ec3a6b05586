"""Primary figure, one rule for "lies above", and what becomes of ranks when something is left out."""

import numpy as np
import pandas as pd
import pytest
from made_tables import made, seeds

from usbench.results import ranking, scores, stats

LOW, HIGH = [[0.1], [0.2], [0.3], [0.4], [0.5]], [[0.6], [0.7], [0.8], [0.9], [1.0]]


def test_overall_is_sorted_and_ties_go_by_name():
    known = made(*seeds("vpg", [0.5, 0.5]), *seeds("a2c", [0.5, 0.5]), *seeds("ppo", [0.7, 0.9]))
    table = ranking.overall(scores.matrices(known)[0])
    assert list(table["agent"]) == ["ppo", "a2c", "vpg"]
    assert list(table["score"]) == pytest.approx([0.8, 0.5, 0.5])
    assert list(table["optimality_gap"]) == pytest.approx([0.2, 0.5, 0.5])


def test_whole_seeds_keep_what_a_seed_did_in_all_cells():
    # A good and a bad seed in both cells: drawn by cell they make up for each other, drawn whole they do not.
    good_or_bad = np.repeat([[0.0], [1.0]] * 5, 2, axis=1)
    row = ranking.overall({"a": good_or_bad}).iloc[0]
    assert row["whole_high"] - row["whole_low"] > row["score_high"] - row["score_low"] > 0
    # A seed that is good in one cell and bad in the other: drawn whole, nothing ever moves.
    row = ranking.overall({"a": np.array([[0.0, 1.0], [1.0, 0.0]] * 5)}).iloc[0]
    assert row["whole_low"] == row["score"] == row["whole_high"] and row["score_low"] < row["score_high"]


def test_a_cell_that_the_primary_figure_leaves_out_counts_in_the_mean_of_the_cells():
    fine = np.full((5, 5), 1.0)
    fine[:, 0] = 0.2
    row = ranking.overall({"a": fine}).iloc[0]
    assert row["score"] == 1 and row["cells"] == pytest.approx((0.2 + 4) / 5)


def test_variance_that_is_common_to_the_cells_of_a_seed():
    generator = np.random.default_rng(2)
    seed, own = generator.normal(size=(500, 1)), generator.normal(size=(500, 6))
    assert ranking.common_to_seeds({"a": seed + np.zeros(6)}) == pytest.approx(1)
    assert ranking.common_to_seeds({"a": own}) == pytest.approx(0, abs=0.03)
    # In units of its spread, whatever the spread of a cell.
    half = (seed + own) * np.array([1, 10, 1, 1, 0.1, 1])
    assert ranking.common_to_seeds({"a": half, "b": half[::-1]}) == pytest.approx(0.5, abs=0.05)
    # Cells in which all seeds score the same do not count.
    constant = np.hstack([half, np.ones((500, 6))])
    assert ranking.common_to_seeds({"a": constant}) == pytest.approx(ranking.common_to_seeds({"a": half}))


def test_one_seed_or_one_cell_has_no_such_share():
    for scores_of in ({"a": np.ones((1, 6))}, {"a": np.array(LOW)}, {"a": np.full((5, 6), 0.8502)}, {}):
        assert np.isnan(ranking.common_to_seeds(scores_of))


def test_improvement_in_both_directions():
    table = ranking.improvement({"a": np.array([[0.2], [0.6]]), "b": np.array([[0.1], [0.5]])})
    table = table.set_index(["agent", "other"])
    assert table["probability"]["a", "b"] == 0.75 and table["probability"]["b", "a"] == 0.25


@pytest.mark.parametrize("kind", ["", "sure_", "whole_"])
def test_the_interval_of_one_way_round_is_that_of_the_other_mirrored(kind):
    generator = np.random.default_rng(3)
    table = ranking.improvement({"a": generator.normal(0.3, 1, (6, 4)), "b": generator.normal(size=(8, 4))})
    there, back = table.iloc[0], table.iloc[1]
    assert (there["agent"], there["other"]) == (back["other"], back["agent"])
    low, high = f"{kind}low", f"{kind}high"
    assert [back[low], back[high]] == [1 - there[high], 1 - there[low]] and there[low] < there[high]


def test_level_is_corrected_for_the_number_of_pairs():
    assert ranking.corrected_level(8) == 1 - (1 - stats.LEVEL) / 28
    assert ranking.corrected_level(2) == ranking.corrected_level(1) == pytest.approx(0.95)


def test_corrected_intervals_are_wider():
    generator = np.random.default_rng(0)
    eight = {str(number): generator.normal(number / 10, 1, size=(10, 6)) for number in range(8)}
    pairs = ranking.improvement(eight)
    assert len(pairs) == 56
    assert (pairs["sure_low"] < pairs["low"]).all() and (pairs["sure_high"] > pairs["high"]).all()


def test_what_is_sure_does_not_depend_on_agents_with_few_seeds():
    generator = np.random.default_rng(0)
    two = {name: generator.normal(mean, 1, size=(6, 1)) for name, mean in (("a", 0), ("b", 1.5))}
    few = {str(number): generator.normal(size=(2, 1)) for number in range(6)}
    assert ranking.sure_level(map(len, (two | few).values())) == ranking.corrected_level(2)
    assert ranking.sure_level([2, 2, 2]) == ranking.corrected_level(3)  # none of them is sure
    both = [
        ranking.improvement(agents).set_index(["agent", "other"]).loc[("b", "a")]
        for agents in (two, two | few)
    ]
    pd.testing.assert_series_equal(*both)


def test_lies_above_by_one_rule():
    middle = np.array([[0.05], [0.25], [0.35], [0.45], [0.55]])
    pairs = ranking.improvement({"low": np.array(LOW), "middle": middle, "high": np.array(HIGH)})
    assert ranking.above(pairs) == {("high", "low"), ("high", "middle")}


@pytest.mark.parametrize("n_seeds", [1, 2, 4])
def test_few_seeds_lie_above_nothing(n_seeds):
    pairs = ranking.improvement({"low": np.array(LOW), "high": np.array(HIGH)[:n_seeds]})
    assert ranking.above(pairs) == set()
    assert pairs["low"].isna().all() == (n_seeds == 1)


def test_what_only_some_seeds_win_is_not_sure_with_whole_seeds():
    # One seed in five loses in all six cells: by cells nearly sure, by whole seeds not.
    y = np.tile(np.linspace(0.4, 0.6, 10)[:, np.newaxis], 6)
    x = np.tile(np.array([[0.9], [0.9], [0.9], [0.9], [0.9], [0.9], [0.9], [0.1], [0.1], [0.1]]), 6)
    pairs = ranking.improvement({"x": x, "y": y})
    assert ranking.above(pairs) == ranking.above_by_cells_alone(pairs) == {("x", "y")}
    sure = ranking.improvement({"x": np.array(HIGH), "y": np.array(LOW)})
    assert ranking.above(sure) == {("x", "y")} and ranking.above_by_cells_alone(sure) == set()


def test_interval_is_that_of_the_plain_bootstrap():
    generator = np.random.default_rng(1)
    x, y = generator.normal(0.1, 1, size=(10, 6)), generator.normal(size=(7, 6))
    pair = ranking.improvement({"x": x, "y": y}).iloc[0]
    plain = stats.stratified_bootstrap(
        stats.probability_of_improvement, x, y, generator=generator, n_resamples=5000
    )
    assert pair["probability"] == pytest.approx(plain.estimate)
    assert [pair["low"], pair["high"]] == pytest.approx([float(plain.low), float(plain.high)], abs=0.01)


def frames(**scores_of):
    return {agent: pd.DataFrame(np.array(rows)) for agent, rows in scores_of.items()}


def test_ranks_without_a_cell_and_without_two_seeds_by_hand():
    # b leads by its second cell alone, and by the last two of four seeds alone.
    finals = frames(a=[[0.5, 0.5]] * 4, b=[[0.4, 0.5], [0.4, 0.5], [0.4, 1.0], [0.4, 1.0]])
    table = ranking.stability(finals).set_index("agent")
    assert list(table.index) == ["a", "b"] and list(table["rank"]) == [1, 2]
    assert table.loc["b", ["cells_best", "cells_worst"]].tolist() == [1, 2]
    # Means of the middle half: with seeds 2 and 3 alone, 0.7; with 0 and 1 alone, 0.45; a always has 0.5.
    assert table.loc["b", ["seeds_best", "seeds_worst"]].tolist() == [1, 2]


def test_nothing_to_leave_out():
    table = ranking.stability(frames(a=[[0.5]] * 3, b=[[0.6]] * 5))
    assert table[["cells_best", "cells_worst", "seeds_best", "seeds_worst"]].isna().all(axis=None)
    assert ranking.stability({}).empty
