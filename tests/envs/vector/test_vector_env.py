"""Environments in step: what Gymnasium's own vector of single ones gives, from every task's id."""

import pickle
from types import MappingProxyType

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AutoresetMode
from quick_trials import DrawnFrames
from stored import fresh_stores

from usbench.envs import frames
from usbench.envs.anatomy import Recording
from usbench.envs.guidance import GuidanceEnv
from usbench.envs.pose import Pose
from usbench.envs.tasks.probe_plane import ProbePlaneEnv
from usbench.envs.vector.environment import GuidanceVectorEnv
from usbench.tasks import BUILT_IN

PP = BUILT_IN["pp"].env_id
MODES = [mode.value for mode in AutoresetMode]


def made(env_id=PP, num_envs=3, autoreset_mode="NextStep", **kwargs):
    """The vector of this package, and Gymnasium's vector of single environments."""
    return (
        gym.make_vec(env_id, num_envs, "vector_entry_point", autoreset_mode=autoreset_mode, **kwargs),
        gym.make_vec(env_id, num_envs, "sync", vector_kwargs={"autoreset_mode": autoreset_mode}, **kwargs),
    )


def assert_alike(ours, theirs, n_steps, seed=5):
    """Both see the same: observations, rewards, ends and infos, with the types of Gymnasium's."""
    ours.action_space.seed(seed)
    assert data_equivalence(ours.reset(seed=seed), theirs.reset(seed=seed), exact=True)
    n_ends = 0
    for _ in range(n_steps):
        actions = ours.action_space.sample()
        one, other = ours.step(actions), theirs.step(actions)
        assert data_equivalence(one, other, exact=True)
        done = one[2] | one[3]
        n_ends += done.sum()
        if done.any() and ours.metadata["autoreset_mode"] is AutoresetMode.DISABLED:
            one, other = (env.reset(options={"reset_mask": done}) for env in (ours, theirs))
            assert data_equivalence(one, other, exact=True)
    return n_ends


@pytest.mark.filterwarnings("ignore:.*is out of date:DeprecationWarning")  # of an earlier version
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("task", BUILT_IN)
def test_every_task_gives_what_single_environments_give(task, mode, coded):
    ours, theirs = made(BUILT_IN[task].env_id, autoreset_mode=mode, noise=0.5)
    for name in ("observation_space", "single_observation_space", "action_space", "single_action_space"):
        assert getattr(ours, name) == getattr(theirs, name)
    assert ours.num_envs == 3 and ours.metadata == theirs.metadata and ours.render_mode is None
    # exam-stop ends at different times, where its agent stops.
    assert assert_alike(ours, theirs, 2 * BUILT_IN[task].n_steps + 5) >= 6
    ours.close()
    theirs.close()
    assert ours.closed


@pytest.mark.parametrize("mode", MODES)
def test_a_reward_from_frames_is_the_same(mode, monkeypatch):
    monkeypatch.setattr("usbench.envs.guidance.frame_store", lambda *_: DrawnFrames())
    monkeypatch.setattr("usbench.envs.guidance.standard_view", lambda *_: DrawnFrames().frame(Pose(0, 50, 0)))
    assert assert_alike(*made(autoreset_mode=mode, reward="image", noise=0.5), 20) == 3


def test_frames_of_all_environments_are_simulated_in_one_call_with_the_bits_of_one_by_one(monkeypatch):
    calls = []

    def counted(scenes, *scene):
        calls.append(len(scenes))
        return scan_batch(scenes, *scene)

    fresh_stores(monkeypatch)
    scan_batch = frames.scan_batch
    monkeypatch.setattr(frames, "scan_batch", counted)
    ours, theirs = made(BUILT_IN["pp-random"].env_id, autoreset_mode="SameStep", max_episode_steps=2)
    (seen, _), (alone, _) = ours.reset(seed=1), theirs.reset(seed=1)
    assert np.array_equal(seen, alone) and np.ptp(seen) > 100
    for _ in range(2):
        assert data_equivalence(ours.step([3, 3, 4]), theirs.step([3, 3, 4]), exact=True)
    # Reset, a step, and a step with which every episode ends and another begins.
    assert calls == [3, 3, 3, 3]


def test_a_recorded_image_is_sliced_for_every_environment(tissue_file):
    ours, theirs = made(phantom=Recording.read(tissue_file))
    assert assert_alike(ours, theirs, 18) == 3


def test_frames_that_are_kept_are_looked_up(scans):
    env = gym.make_vec(PP, num_envs=4)
    start = {"x_mm": 0, "angle_deg": 60}
    env.reset(options=start)
    env.step([0, 1, 2, 1])
    env.reset(options=start)
    # One for all environments of one phantom, however many stand there.
    assert len(scans) == 3 and len(set(scans)) == 3


def test_autoreset_with_the_next_step(coded):
    env = gym.make_vec(PP, num_envs=2, max_episode_steps=2)
    assert env.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    env.reset(seed=0)
    env.reset(options={"reset_mask": np.array([True, False])})
    ends = [env.step([0, 0])[3].tolist() for _ in range(2)]
    assert ends == [[False, False], [True, True]]
    _, rewards, _, truncations, _ = env.step([3, 3])
    assert not rewards.any() and not truncations.any()
    assert env.step([3, 3])[1].all()


def test_autoreset_in_the_same_step_keeps_what_was_last(coded):
    env = gym.make_vec(PP, num_envs=2, max_episode_steps=1, autoreset_mode=AutoresetMode.SAME_STEP)
    first, _ = env.reset(seed=0)
    observations, _, _, truncations, infos = env.step([0, 0])
    assert truncations.all() and infos["_final_obs"].all() and infos["_final_info"].all()
    assert np.array_equal(np.stack(infos["final_obs"]), first)
    assert not np.array_equal(observations, first)
    assert (observations[:, 0, 0, 0] == infos["x_mm"] + 20).all()


def test_without_autoreset_a_mask_begins_episodes(coded):
    env = gym.make_vec(PP, num_envs=3, autoreset_mode="Disabled", max_episode_steps=1)
    env.reset(seed=0)
    before = env.step([1, 1, 1])[0]
    with pytest.raises(gym.error.ResetNeeded, match=r"environments \[0, 1, 2\] have ended"):
        env.step([0, 0, 0])
    options = {"reset_mask": np.array([True, False, False]), "x_mm": 15, "angle_deg": 90}
    observations, infos = env.reset(options=options)
    assert "reset_mask" in options  # the caller's own stays as it is
    assert np.array_equal(observations[1:], before[1:]) and observations[0, 0, 0, 0] == 35
    assert infos["_x_mm"].tolist() == [True, False, False]
    with pytest.raises(gym.error.ResetNeeded, match=r"environments \[1, 2\] have ended"):
        env.step([0, 0, 0])


def test_seeds(coded):
    env = gym.make_vec(PP, num_envs=3)
    env.reset(seed=7)
    assert env.np_random_seed == (7, 8, 9)
    poses = env.get_attr("pose")
    env.reset()
    assert env.np_random_seed == (7, 8, 9)
    env.reset(seed=np.int64(7))
    assert env.get_attr("pose") == poses
    env.reset(seed=[9, None, 7])
    assert (env.envs[0].pose, env.envs[2].pose) == (poses[2], poses[0])
    assert len(env.np_random) == 3


def test_a_seed_in_an_array_without_axes_is_one_number(coded):
    env, _ = made()
    env.reset(seed=np.array(7))
    assert env.np_random_seed == (7, 8, 9)


def test_every_environment_has_the_senses_of_an_iterator():
    env = GuidanceVectorEnv(ProbePlaneEnv, 2, senses=iter(("position",)))
    assert [one.senses.names for one in env.envs] == [("position",)] * 2


def test_options_are_any_mapping_as_those_of_a_single_environment(coded):
    options = MappingProxyType({"x_mm": 5})
    for env in (GuidanceVectorEnv(ProbePlaneEnv, 2), ProbePlaneEnv()):
        _, info = env.reset(seed=0, options=options)
        assert np.all(info["x_mm"] == 5)


def test_a_refused_reset_changes_nothing(coded):
    env, other = made()[0], made()[0]
    for one in (env, other):
        one.reset(seed=0)
    with pytest.raises(ValueError, match="x_mm"):
        env.reset(seed=5, options={"x_mm": 1000})
    assert data_equivalence(env.reset(), other.reset(), exact=True)


def test_an_observation_is_the_callers_own(coded):
    env = gym.make_vec(PP, num_envs=2)
    first, _ = env.reset(seed=0, options={"x_mm": 0})
    kept = first.copy()
    seen, *_ = env.step([1, 2])
    assert np.array_equal(first, kept) and not np.array_equal(seen, first)
    seen[...] = 0
    assert env.step([0, 0])[0].any()


def test_pictures_attributes_and_pickles(coded):
    env = gym.make_vec(PP, num_envs=2, render_mode="rgb_array", noise=0.5)
    env.reset(seed=0)
    pictures = env.render()
    assert env.render_mode == "rgb_array" and isinstance(pictures, tuple) and len(pictures) == 2
    assert all(one.dtype == np.uint8 and one.ndim == 3 for one in pictures)
    assert len(env.call("render")) == 2 and env.get_attr("noise") == (0.5, 0.5)
    twin = pickle.loads(pickle.dumps(env))
    assert data_equivalence(env.step([1, 2]), twin.step([1, 2]), exact=True)
    env.set_attr("is_watched", [False, True])
    observations, *_ = env.step([0, 0])
    assert not observations[0].any() and observations[1].any()
    with pytest.raises(ValueError, match="values must be 2, one per environment, not 3"):
        env.set_attr("noise", [0, 0, 0])


def test_the_id_still_has_a_specification_of_text_alone():
    assert "usbench.envs.vector.entry:" in gym.spec(PP).to_json()
    env = gym.make_vec(PP, num_envs=2)
    assert str(env) == f"GuidanceVectorEnv({PP}, num_envs=2)" and env.spec.id == PP
    assert gym.make_vec(env.spec).num_envs == 2


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"num_envs": 0}, "num_envs must be a whole number from 1, not 0"),
        ({"num_envs": -2}, "num_envs must be a whole number from 1, not -2"),
        ({"num_envs": 2.5}, "num_envs must be a whole number from 1, not 2.5"),
        (
            {"autoreset_mode": "SameStp"},
            "unknown autoreset_mode 'SameStp' .did you mean 'SameStep'.*Disabled",
        ),
        ({"max_episode_steps": 0}, "max_episode_steps must be a whole number from 1, not 0"),
        ({"noise": 2}, "noise must be a probability"),
        ({"render_mode": "human"}, "unknown render_mode 'human'"),
    ],
)
def test_refuses_a_configuration(kwargs, message):
    with pytest.raises(ValueError, match=message):
        gym.make_vec(PP, **({"num_envs": 2} | kwargs))
    with pytest.raises(TypeError, match="num_envs must be a whole number from 1, not '4'"):
        gym.make_vec(PP, num_envs="4")


def test_refuses_a_class_whose_step_it_cannot_divide():
    class Own(ProbePlaneEnv):
        def step(self, action):
            return super().step(action)

    with pytest.raises(TypeError, match="Own has a step or reset of its own.*vectorization_mode='sync'"):
        GuidanceVectorEnv(Own, 2)
    assert GuidanceVectorEnv(ProbePlaneEnv).max_episode_steps == 16
    assert issubclass(ProbePlaneEnv, GuidanceEnv)


@pytest.mark.parametrize(
    ("actions", "message"),
    [
        ([0], "actions must be 2 whole numbers"),
        ([0.0, 1.0], "actions must be 2 whole numbers"),
        ([[0], [1]], "actions must be 2 whole numbers"),
        ([True, False], "actions must be 2 whole numbers"),
        ([0, 5], "actions must be whole numbers from 0 to 4"),
        ([-1, 0], "actions must be whole numbers from 0 to 4"),
    ],
)
def test_refuses_actions_before_anything_moves(actions, message, coded):
    env = gym.make_vec(PP, num_envs=2)
    with pytest.raises(gym.error.ResetNeeded, match="reset"):
        env.step([0, 0])
    env.reset(seed=0)
    poses = env.get_attr("pose")
    with pytest.raises(ValueError, match=message):
        env.step(actions)
    assert env.get_attr("pose") == poses


@pytest.mark.parametrize(
    ("kwargs", "error", "message"),
    [
        ({"seed": -1}, ValueError, "seed must be a whole number from 0, not -1"),
        ({"seed": "one"}, TypeError, "seed must be a whole number from 0, not 'one'"),
        ({"seed": [1]}, ValueError, "seed must be one number, or 2, not 1"),
        ({"seed": [1, 0.5]}, ValueError, "seed must be a whole number from 0, not 0.5"),
        ({"options": {"y_mm": 0}}, ValueError, "unknown option 'y_mm'"),
        ({"options": [1]}, TypeError, "options must be a dict"),
        ({"options": 1}, TypeError, "options must be a dict"),
        ({"options": {"reset_mask": [True, False]}}, ValueError, "must be a bool array of shape .2,."),
        ({"options": {"reset_mask": np.array([1, 0])}}, ValueError, "must be a bool array of shape .2,."),
        ({"options": {"reset_mask": np.array([True])}}, ValueError, "must be a bool array of shape .2,."),
        ({"options": {"reset_mask": np.zeros(2, bool)}}, ValueError, "with a True in it"),
    ],
)
def test_refuses_a_reset(kwargs, error, message, coded):
    with pytest.raises(error, match=message):
        gym.make_vec(PP, num_envs=2).reset(**kwargs)
