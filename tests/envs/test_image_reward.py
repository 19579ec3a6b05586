"""The reward that is computed from the frame alone."""

import numpy as np
import pytest
from quick_trials import DrawnFrames

from usbench.envs.bmode import Imaging
from usbench.envs.image_reward import TEXTBOOK, likeness, standard_view
from usbench.envs.oracle import policy
from usbench.envs.pose import Pose
from usbench.envs.scanner import scan
from usbench.envs.tasks.examination import ExaminationStopEnv
from usbench.envs.tasks.phantom_distribution import LAST
from usbench.envs.tasks.probe_plane import PROBE_PLANE, ProbePlaneEnv
from usbench.envs.tasks.random_phantoms import ProbePlaneRandomEnv


def blob(x_px=19.5, z_px=45.0, height=200.0):
    """A frame with a bright spot on a dark background."""
    x, z = np.arange(40)[np.newaxis] - x_px, np.arange(90)[:, np.newaxis] - z_px
    return (20 + height * np.exp(-((x / 8) ** 2) - (z / 10) ** 2)).astype(np.uint8)


def test_a_view_is_like_itself_at_any_depth_but_not_beside():
    assert likeness(blob(), blob()) == pytest.approx(1)
    assert likeness(blob(z_px=55), blob()) == pytest.approx(1, abs=0.01)
    beside = [likeness(blob(x_px=19.5 + shift), blob()) for shift in (0, 5, 10, 15)]
    assert beside == sorted(beside, reverse=True) and beside[-1] < 0.3


def test_half_the_contrast_is_as_alike_as_the_formula_says():
    # 2 cov / (var + var) = 2 * 0.5 / (0.25 + 1); where it lies in grey makes no difference.
    faint = (blob() // 2 + 60).astype(np.uint8)
    assert likeness(faint, blob()) == pytest.approx(0.8, abs=0.01)
    assert likeness(255 - blob(), blob()) < 0.2


def test_nothing_is_not_like_nothing():
    # As frames of half a decibel are, whose few bright pixels the median removes.
    black = np.zeros((90, 40), np.uint8)
    assert likeness(black, black) == 0


def test_the_textbooks_phantom_is_in_no_episode():
    assert TEXTBOOK.seed > LAST


@pytest.fixture
def drawn(monkeypatch):
    """Frames that are drawn, in place of the simulator's: every pose has another likeness."""
    monkeypatch.setattr("usbench.envs.guidance.frame_store", lambda *_: DrawnFrames())


@pytest.fixture
def view(monkeypatch):
    """A standard view that needs no simulation."""
    monkeypatch.setattr("usbench.envs.guidance.standard_view", lambda *_: blob())
    return blob()


def test_the_reward_follows_from_the_frame_and_the_truth_stays_in_info(drawn, view):
    env = ProbePlaneEnv(reward="image")
    env.reset(options={"x_mm": 10, "angle_deg": 30})
    observation, reward, _, _, info = env.step(0)
    assert reward == likeness(observation[:, :, 0], view) - 1
    assert info["true_reward"] == PROBE_PLANE.reward(Pose(10, 50, 30), Pose(0, 50, 0), "normalized")
    env = ProbePlaneEnv()
    env.reset(seed=0)
    assert "true_reward" not in env.step(0)[4]


def test_it_is_that_of_the_pose_before_the_slip(drawn, view):
    slipping, steady = ProbePlaneEnv(reward="image", noise=1.0), ProbePlaneEnv(reward="image")
    rewards = []
    for env in (slipping, steady):
        env.reset(seed=1, options={"x_mm": 5, "angle_deg": 30})
        rewards.append(env.step(1)[1])
    assert rewards[0] == rewards[1] > -1


def test_a_stop_earns_it_for_every_step_left(drawn, view):
    env = ExaminationStopEnv(reward="image")
    env.reset(options={"x_mm": 10, "focal_depth_mm": 40, "angle_deg": 30})
    frame, once, _, _, first = env.step(0)
    _, reward, _, _, info = env.step(7)
    assert reward == pytest.approx(23 * once)
    assert info["true_reward"] == pytest.approx(23 * first["true_reward"])


def test_the_optimum_is_not_known_for_it_and_other_kinds_are_refused():
    with pytest.raises(ValueError, match="unknown reward 'image'.*allowed are 'normalized', 'paper'"):
        policy("pp", reward="image")
    with pytest.raises(ValueError, match="unknown reward 'images' .did you mean 'image'.*'paper', 'image'"):
        ProbePlaneEnv(reward="images")


def test_the_optimum_is_known_where_the_environment_tells_the_rewards(drawn, view):
    env = ProbePlaneEnv(reward="image")
    best = policy("pp", rewards=env.state_rewards())
    env.reset(seed=3)
    start, earned = env.pose, 0.0
    for step in range(16):
        earned += env.step(best.action(step, env.pose))[1]
    assert earned == pytest.approx(best.value(0, start))


def test_an_image_that_ends_above_the_object_has_no_standard_view():
    with pytest.raises(ValueError, match="the image must be at least 50 mm deep, .* not 40 mm"):
        ProbePlaneEnv(reward="image", imaging=Imaging(height_px=40))


def test_in_tissue_never_seen_the_standard_plane_is_most_like_the_textbook():
    env = ProbePlaneRandomEnv()
    phantom = env.distribution.phantom(5)
    x_mm, depth_mm, angle_deg = phantom.target.x_mm, 50, phantom.target.angle_deg
    step = -10 if x_mm > 0 else 10
    poses = [
        (x_mm, angle_deg),
        (x_mm + step, angle_deg),
        (x_mm + 2 * step, angle_deg),
        (x_mm, angle_deg + 90),
    ]
    view = standard_view(env.probe, env.imaging)
    alike = [likeness(scan(phantom, Pose(x, depth_mm, angle)), view) for x, angle in poses]
    assert alike[0] > 0.85 and alike[0] > max(alike[1:]) + 0.03
    assert alike[1] > alike[2]
