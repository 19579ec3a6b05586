"""Trials of the leaderboard that are drawn to be trained again."""

import sys
from pathlib import Path

import again
import numpy as np
import pytest

from usbench.compare import plan, protocol
from usbench.compare.sweep import Outcome
from usbench.results import scores, tables
from usbench.results.tables import GREEDY

GRID = Path(__file__).parents[2] / "leaderboard_files"


PLANNED = [config.folder_name for config in plan.by_protocol(protocol.read()) if config.steps]
N_TRIALS = len(PLANNED)


@pytest.fixture(scope="module")
def known():
    return tables.read(GRID)


def test_drawn_trials_are_finished_trials_of_the_grid_and_the_same_every_time(known):
    drawn = again.drawn(known, 1, N_TRIALS)
    assert len({config.folder_name for config in drawn}) == N_TRIALS
    assert {config.folder_name for config in drawn} <= set(known.trials["trial"])
    assert again.drawn(known, 1, 2) == again.drawn(known, 1, 2) != again.drawn(known, 2, 2)


def test_scores_and_spread_are_those_of_the_cell(known):
    cells = scores.cells(known.of(known.trials[known.trials["trial"].isin(PLANNED)]))
    cells = cells[(cells["table"] == "grid") & (cells["actions"] == GREEDY)].set_index(
        ["task", "noise", "agent"]
    )
    drawn = again.drawn(known, 1, N_TRIALS)
    cell = [config for config in drawn if (config.task, config.noise, config.algo) == ("pp", 0.5, "trpo")]
    found, spreads = zip(*(again.scores(known, config) for config in cell), strict=True)
    assert np.mean(found) == pytest.approx(cells.loc[("pp", 0.5, "trpo"), "normalized_score"], abs=1e-5)
    assert spreads == pytest.approx([np.std(found, ddof=1)] * len(found))


@pytest.mark.parametrize(
    ("number", "n_trials", "words"),
    [(-1, 2, "draw must be"), (1, 0, "trials must be"), (1, N_TRIALS + 1, rf"\[1, {N_TRIALS}\]")],
)
def test_a_draw_that_cannot_be_is_refused(known, number, n_trials, words):
    with pytest.raises(ValueError, match=words):
        again.drawn(known, number, n_trials)


def test_a_trial_that_failed_is_told_after_the_rows_of_the_others(known, monkeypatch, capsys):
    def run(configs, *_, **__):
        return [Outcome(config, reason) for config, reason in zip(configs, (None, "no disk"), strict=True)]

    monkeypatch.setattr(again.tables, "read", lambda _: known)
    monkeypatch.setattr(again.sweep, "run", run)
    monkeypatch.setattr(again, "row", lambda _, config, __: (config.title, *"12345"))
    monkeypatch.setattr(sys, "argv", ["again.py", "--draw", "1"])
    done, failed = again.drawn(known, 1, 2)
    with pytest.raises(SystemExit, match=f"^{failed.title} failed: no disk$"):
        again.main()
    shown = capsys.readouterr().out
    assert done.title in shown and failed.title not in shown
