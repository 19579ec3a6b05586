"""The rules by which docs/paper.md says whether a sentence of the paper holds."""

from pathlib import Path

import pandas as pd
import paper

from usbench.results import tables

GRID = Path(__file__).parents[2] / "leaderboard_files"


def test_a_noise_with_which_one_task_is_not_trained_decides_nothing():
    known = tables.read(GRID)
    agent = known.of(known.trials[(known.trials["algo"] == paper.AGENT) & (known.trials["noise"] < 0.5)])
    fp = agent.trials["task"] == "fp"
    more = agent.trials[fp & (agent.trials["noise"] == 0.25)]
    more = more.assign(noise=0.5, trial="more-" + more["trial"])
    curves = agent.curves[agent.curves["trial"].isin(more["trial"].str.removeprefix("more-"))]
    one_task = tables.Results(
        pd.concat([agent.trials, more]),
        pd.concat([agent.curves, curves.assign(trial="more-" + curves["trial"])]),
    )
    found, before = paper.noise(one_task), paper.noise(agent)
    assert (found.holds, found.rule) == (before.holds, before.rule)
    assert "nan" not in found.numbers and found.numbers.splitlines()[-1].endswith("| – |")
