"""The filter of the belief agent: Bayes' rule, anew in every episode."""

import numpy as np
import torch

from usbench.agents import zoo
from usbench.agents.vec_env import SB3VecEnv
from usbench.setting import Setting
from usbench.trials import knowledge

SMALL = {"learning_starts": 16, "train_freq": 4, "batch_size": 16, "buffer_size": 1000}
SETTING = Setting(task="pp-tracked", n_frames=1)


def made():
    env = SB3VecEnv(SETTING.make_vec_env(4, autoreset_mode="SameStep"))
    for one in env.env.unwrapped.envs:
        one.is_watched = False
    chosen = zoo.hyperparameters("belief", "pp-tracked", SMALL)
    return zoo.make("belief", env, 0, chosen, device="cpu", model=knowledge.scene_model(SETTING))


def test_a_frame_that_tells_no_more_than_how_often_looks_come_tells_nothing():
    """Bayes: a posterior that is the prior of training has a likelihood that is the same for all places."""
    agent = made()
    counts = torch.arange(1.0, agent.model.n_looks + 1)
    agent.policy.counts.copy_(counts)

    class Prior(torch.nn.Module):
        def forward(self, observations):
            return counts.log().expand(len(observations["image"]), -1)

    agent.policy.q_net_target = Prior()
    seen = {"image": np.zeros((4, 90, 40, 1), np.float32), "senses": agent.model._told[:4]}
    _, known = agent.predict(seen, None, np.ones(4, bool), deterministic=True)
    np.testing.assert_allclose(known.evidence, 0, atol=1e-4)


def test_a_new_episode_begins_without_what_the_last_one_told():
    agent = made().learn(4 * 17)  # one step of the second episode
    assert agent._known.visited.sum(axis=1).tolist() == [1, 1, 1, 1]
