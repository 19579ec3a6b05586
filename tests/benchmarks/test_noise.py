"""Trained agents examined with other noise than in their training."""

import sys
from dataclasses import replace

import noise
import pytest

from usbench.records import Trial
from usbench.setting import Setting
from usbench.trials.configuration import resolve
from usbench.trials.model_loading import load_agent


def test_an_agent_examined_with_its_own_noise_has_its_own_score(finished):
    trial = Trial.read(finished)
    own = trial.last_evaluation(deterministic=True)
    found = noise.examine(str(finished), [trial.config.noise, 0.0])
    assert found.scores[0] == pytest.approx(own["normalized_score"].mean(), abs=1e-9)
    assert found.at_goal[0] == own["is_success"].mean()
    assert found.scores[1] != found.scores[0]


def test_agents_can_be_examined_with_means_over_moved_pictures(quick):
    plain, averaged = load_agent("best:pp-tracked"), load_agent("best:pp-tracked")
    averaged.agent.policy.greedy_shift_px = 2
    setting = Setting.recorded(plain.config)
    scores = [noise._played(one.agent, setting)[0] for one in (plain, averaged)]
    found = [noise.examine("best:pp-tracked", [0.0], shift).scores for shift in (None, 0, 2)]
    assert found == [(scores[0],), (scores[0],), (scores[1],)] and scores[0] != scores[1]


def test_the_mean_is_of_agents_that_differ_in_their_seed_alone():
    one = noise.Examined(resolve("dqn", "pp", seed=100), (0.25,), (0.5,))
    other = replace(one, config=resolve("dqn", "pp", seed=101), scores=(0.75,))
    alone = replace(one, config=resolve("dqn", "pp", seed=100, noise=0.5))
    shown = noise.table([one, alone, other], [0.0])
    assert list(shown.columns[3].cells) == ["100", "101", "IQM", "100"]
    assert list(shown.columns[4].cells) == ["0.250 (50%)", "0.750 (50%)", "0.500", "0.250 (50%)"]


@pytest.mark.parametrize(
    ("argv", "said"),
    [
        (["best:pp", "--noise", "2"], "a probability in [0, 1]"),
        (["best:nothing"], "best:pp"),
        (
            ["best:pp", "--greedy-shift-px", "2"],
            "best:pp takes no greedy_shift_px: allowed are agents of double",
        ),
        (["best:pp-tracked", "--greedy-shift-px", "11"], "greedy_shift_px must be a whole number in [0, 10]"),
    ],
)
def test_what_cannot_be_examined_is_refused(monkeypatch, capsys, argv, said):
    monkeypatch.setattr(sys, "argv", ["noise.py", *argv])
    with pytest.raises(SystemExit, match="2"):
        noise.main()
    assert said in capsys.readouterr().err
