"""The rules by which docs/paper.md says whether a sentence of the paper holds."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from made_tables import made, seeds
from paper_sentences import endings, training
from paper_sentences.sentence import AGENT, FAILS, HOLDS, OPEN, PARTLY, of_intervals

from usbench.results import tables

GRID = Path(__file__).parents[2] / "leaderboard_files"


def test_a_noise_with_which_one_task_is_not_trained_decides_nothing():
    known = tables.read(GRID)
    agent = known.of(known.trials[(known.trials["algo"] == AGENT) & (known.trials["noise"] < 0.5)])
    fp = agent.trials["task"] == "fp"
    more = agent.trials[fp & (agent.trials["noise"] == 0.25)]
    more = more.assign(noise=0.5, trial="more-" + more["trial"])
    curves = agent.curves[agent.curves["trial"].isin(more["trial"].str.removeprefix("more-"))]
    one_task = tables.Results(
        pd.concat([agent.trials, more]),
        pd.concat([agent.curves, curves.assign(trial="more-" + curves["trial"])]),
    )
    found, before = training.noise(one_task), training.noise(agent)
    assert (found.holds, found.rule) == (before.holds, before.rule)
    assert "nan" not in found.numbers and found.numbers.splitlines()[-1].endswith("| – |")


def test_what_noise_takes_holds_only_where_its_interval_leaves_out_0():
    quiet, half = np.linspace(9, 11, 10), np.linspace(4, 6, 10)
    fp, pp, more = training.lost({"fp": (quiet, 0.9 * quiet), "pp": (quiet, half)})
    assert more.estimate == pytest.approx(0.4) and fp.low < fp.estimate < fp.high
    assert of_intervals((fp, pp, more)) == HOLDS
    fp, pp, more = training.lost({"fp": (quiet, half), "pp": (quiet, 0.9 * quiet)})
    assert of_intervals((fp, pp, more)) == PARTLY
    spread = np.linspace(1, 19, 10)
    assert of_intervals(training.lost({"fp": (quiet, half), "pp": (spread, spread - 0.5)})) == OPEN


@pytest.mark.parametrize(("share", "said"), [(0.005, "1 of 200"), (0.01, "2 of 200")])
def test_one_episode_is_not_sometimes(share, said):
    known = made(*seeds("vpg", [0.5] * 10))  # each with 20 episodes
    ends = pd.DataFrame([{"task": "fp", "noise": 0.0, "too_deep": share}])
    found = endings.sometimes(known, ends, "too_deep")
    assert found == (f"{said} episodes end so.", FAILS if share < 0.01 else HOLDS)


def test_shares_of_fewer_trials_than_the_leaderboard_has_are_refused():
    known = made(*seeds("vpg", [0.5] * 10))
    of_one = pd.DataFrame([{"task": "fp", "noise": 0.0, "algo": "vpg", "seeds": 1}])
    with pytest.raises(ValueError, match=r"vpg on fp, noise 0 in ends.csv is of 1 trials, .* all 10"):
        endings.endings(known, of_one)
