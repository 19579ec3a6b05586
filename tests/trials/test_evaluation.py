"""Evaluation episodes, played in step: what an agent remembers lasts through its episode, and no longer."""

import numpy as np
import pytest

from usbench.setting import Setting
from usbench.trials.evaluation import Evaluator


class Counting:
    """An agent whose memory is all that it acts by: 0, 1, 2, 3, 4, 0, 1, .."""

    looks = False

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        before = np.zeros(len(observation), int) if state is None else state
        now = np.where(episode_start, 0, before)
        return now % 5, now + 1


@pytest.mark.parametrize("found", [3, (np.zeros(2, int), None), np.zeros(3, int), (0, None)], ids=repr)
def test_an_agent_that_predicts_something_else_is_refused(found):
    agent = Counting()
    agent.predict = lambda *_, **__: found
    setting = Setting(task="pp")
    evaluator = Evaluator(setting, setting.evaluation_episodes()[:3])
    with pytest.raises(TypeError, match=r"predict must return actions \(3,\) and a state, .*, not "):
        evaluator.play(agent, checkpoint=0, step=0, deterministic=True)


def test_an_agent_keeps_its_memory_through_an_evaluation_episode():
    setting = Setting(task="pp", noise=0.5)
    evaluator = Evaluator(setting, setting.evaluation_episodes()[:3])
    for _ in range(2):  # a second evaluation begins anew
        played = evaluator.play(Counting(), checkpoint=0, step=0, deterministic=True)
        assert [one.actions for one in played] == [tuple(k % 5 for k in range(16))] * 3
