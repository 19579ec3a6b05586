"""TensorBoard's chart of scores between anchors, and frames: read back from the events."""

import numpy as np
import pytest
from stable_baselines3.common.logger import configure
from stable_baselines3.common.vec_env import DummyVecEnv
from tensorboard.backend.event_processing.event_accumulator import IMAGES, SCALARS, TENSORS, EventAccumulator

from usbench.agents import zoo
from usbench.envs.pose import Pose
from usbench.setting import Setting, make_env
from usbench.trials import tensorboard
from usbench.trials.evaluation import Evaluator


@pytest.fixture
def agent(quick, tmp_path, monkeypatch):
    env = DummyVecEnv([lambda: make_env("pp")])
    frames = make_env("pp").unwrapped
    frames.reset(seed=0)
    monkeypatch.setattr(tensorboard, "frame_store", lambda *_: frames._frames)
    agent = zoo.make("vpg", env, 0, zoo.hyperparameters("vpg", "pp"))
    agent.set_logger(configure(str(tmp_path), ["tensorboard"]))
    return agent


def test_scores_anchors_and_frames_are_in_the_events(agent, tmp_path):
    setting = Setting(task="pp", noise=0.0, n_frames=4)
    played = Evaluator(setting, setting.evaluation_episodes()).play(
        agent, checkpoint=0, step=0, deterministic=True
    )
    tensorboard.begin(agent.logger)
    tensorboard.trained(agent.logger, 0.25)
    tensorboard.evaluated(agent, played)
    agent.logger.dump(16)
    agent.logger.close()
    events = EventAccumulator(str(tmp_path), size_guidance={IMAGES: 0, SCALARS: 0, TENSORS: 0}).Reload()
    values = {
        name: [(event.step, event.value) for event in events.Scalars(name)] for name in events.Tags()[SCALARS]
    }
    assert values == {
        tensorboard.TRAINING: [(16, 0.25)],
        tensorboard.RANDOM: [(16, 0.0)],
        tensorboard.OPTIMAL: [(16, 1.0)],
    }
    (picture,) = events.Images(tensorboard.FRAMES)
    # Four episodes in the quick suite, and white between their frames.
    assert (picture.height, picture.width) == (90, 4 * 40 + 3 * tensorboard.GAP_PX)
    assert "custom_scalars__config__" in events.Tags()[TENSORS]


def test_strip_shows_the_final_poses(agent):
    setting = Setting(task="pp", noise=0.0, n_frames=4)
    played = Evaluator(setting, setting.evaluation_episodes()).play(
        agent, checkpoint=0, step=0, deterministic=True
    )
    strip = tensorboard.strip(agent, played[:2])
    last = played[1]
    pose = Pose(*(last.poses[f"final_{name}"] for name in ("x_mm", "focal_depth_mm", "angle_deg")))
    np.testing.assert_array_equal(strip[:, 42:], tensorboard.frame_store().frame(pose))
    assert (strip[:, 40:42] == 255).all()


def test_a_trial_leaves_scores_between_anchors_and_frames(finished):
    events = EventAccumulator(str(finished / "tensorboard"), size_guidance={IMAGES: 0, TENSORS: 0}).Reload()
    tags = events.Tags()
    modes = {f"evaluation/normalized_score_{mode}" for mode in ("stochastic", "deterministic")}
    assert {
        tensorboard.TRAINING,
        tensorboard.RANDOM,
        tensorboard.OPTIMAL,
        "train/policy_loss",
    } | modes <= set(tags[SCALARS])
    # Two checkpoints and the one before training.
    assert [image.step for image in events.Images(tensorboard.FRAMES)] == [0, 64, 128]
    assert "custom_scalars__config__" in tags[TENSORS]
