"""What one setting of a training changes, from scores written by hand."""

import json

import numpy as np
import pandas as pd
import pytest

from usbench.results.protocol.changes import changes
from usbench.results.tables import GREEDY, SAMPLED, Results


def trained(algo, n_frames, seed, score, steps=64):
    """The row of a trial and those of its last evaluation, drawn actions a tenth worse."""
    trial = f"{algo}-{n_frames}-{steps}-{seed}"
    settings = json.dumps({"n_frames": n_frames})
    cell = {"task": "pp", "noise": 0.0, "algo": algo}
    row = {"trial": trial, "seed": seed, "steps": steps, "settings": settings} | cell
    ends = [
        {"trial": trial, "kind": kind, "step": step, "normalized_score": value}
        for kind, value in ((GREEDY, score), (SAMPLED, score - 0.1))
        for step, value in ((0, 0.0), (steps, value))
    ]
    return row, ends


def results(*agents):
    trials, ends = zip(*(trained(*agent) for agent in agents), strict=True)
    return Results(pd.DataFrame(trials), pd.DataFrame([row for own in ends for row in own]))


def test_scores_by_frames_are_means_over_common_seeds_where_there_are_several_numbers():
    single = ("vpg", 1, 0, 0.4), ("vpg", 1, 1, 0.6), ("vpg", 1, 2, 0.0)
    table = changes(results(*single, ("vpg", 4, 0, 0.9), ("vpg", 4, 1, 0.7), ("dqn", 4, 0, 1.0)), "n_frames")
    assert table[["algo", "n_frames", "seeds"]].to_numpy().tolist() == [["vpg", 1, 2], ["vpg", 4, 2]]
    assert table["greedy"].tolist() == pytest.approx([0.5, 0.8])
    assert table["drawn"].tolist() == pytest.approx([0.4, 0.7])
    one, four = table.to_dict("records")
    assert (one["gain"], one["low"], one["high"]) == pytest.approx((-0.3, -0.5, -0.1))
    assert pd.isna(four["gain"])


def test_what_a_single_frame_gains_has_an_interval_that_holds_it():
    gains = np.random.default_rng(0).normal(0.1, 0.02, 20)
    pairs = [
        ("vpg", n, seed, 0.5 + 0.1 * (seed % 3) + (n == 1) * gains[seed])
        for n in (1, 4)
        for seed in range(20)
    ]
    one, _ = changes(results(*pairs), "n_frames").to_dict("records")
    # The seeds themselves differ by more than that.
    assert one["low"] < 0.1 < one["high"] < one["gain"] + 0.03


def test_a_longer_training_is_compared_with_the_shorter_one_of_the_same_seed():
    grid = [("vpg", 4, seed, 0.2 * seed, 64) for seed in range(3)]
    table = changes(results(*grid, ("vpg", 4, 0, 0.3, 256), ("vpg", 4, 1, 0.5, 256)), "steps")
    assert table[["steps", "seeds"]].to_numpy().tolist() == [[64, 2], [256, 2]]
    assert table["greedy"].tolist() == pytest.approx([0.1, 0.4])
    short, long = table.to_dict("records")
    assert pd.isna(short["gain"])
    assert (long["gain"], long["low"], long["high"]) == pytest.approx((0.3, 0.3, 0.3))


@pytest.mark.parametrize("varied", ["n_frames", "steps"])
def test_trials_that_differ_in_more_than_that_are_not_compared(varied):
    assert changes(results(("vpg", 1, 0, 0.5, 64), ("vpg", 4, 0, 0.5, 128)), varied).empty


def test_another_setting_is_refused():
    with pytest.raises(ValueError, match="unknown varied 'gamma': allowed are 'n_frames', 'steps'"):
        changes(results(("vpg", 1, 0, 0.5)), "gamma")
