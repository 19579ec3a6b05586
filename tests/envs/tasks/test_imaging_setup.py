"""The imaging-setup task: its measure of quality, its environment and its anchors."""

import dataclasses

import gymnasium as gym
import numpy as np
import pytest
from brute_force import TARGET, expectimax
from gymnasium.utils.env_checker import check_env

from usbench.envs.bmode import Imaging
from usbench.envs.oracle import DecisionProcess, policy, returns
from usbench.envs.phantom import Phantom
from usbench.envs.pose import Limits, Move, Pose
from usbench.envs.probe import LinearArray
from usbench.envs.settings import Setup
from usbench.envs.tasks.image_quality import (
    contrast_order,
    contrast_to_noise,
    generalized_contrast_to_noise,
)
from usbench.envs.tasks.imaging_setup import (
    GOOD,
    IMAGING,
    IMAGING_SETUP,
    IMAGING_SETUP_V0,
    PHANTOM,
    ImagingSetupEnv,
    ImagingSetupV0Env,
    regions,
)
from usbench.records import ConfigurationError, Episode
from usbench.setting import Setting, make_env
from usbench.trials import runner
from usbench.trials.configuration import resolve
from usbench.trials.recorder import Recorder

ENV_ID = "usbench/ImagingSetup-v1"


class GreyFrames:
    """Stands in for the simulator: a cyst that every setting shows differently well."""

    def frame(self, pose):
        inside, _ = regions(PHANTOM, Pose(), Imaging())
        noise = np.random.default_rng(0).normal(0, 10, (90, 40))
        off = abs(pose.focal_depth_mm - 60) + abs(pose.frequency_khz - 3_000) / 100
        contrast = 50 - 0.2 * off - 0.3 * abs(pose.dynamic_range_db - 40)
        return np.clip(100 - contrast * inside + noise, 0, 255).astype(np.uint8)

    def prepare(self, poses):
        pass


@pytest.fixture
def grey(monkeypatch):
    monkeypatch.setattr("usbench.envs.guidance.frame_store", lambda *_: GreyFrames())


@pytest.fixture
def task(grey):
    """The task with rewards of these frames, apart from the one whose rewards may be known already."""
    return dataclasses.replace(IMAGING_SETUP, title="grey")


def lens(body, part):
    """Area where two circles overlap whose centres are 0.9 body + part apart, mm^2."""
    apart = 0.9 * body + part
    area = 0.0
    for radius, other in ((body, part), (part, body)):
        half = np.arccos((apart**2 + radius**2 - other**2) / (2 * apart * radius))
        area += radius**2 * (half - np.sin(half) * np.cos(half))
    return area


def test_regions_are_where_the_image_plane_cuts_the_object():
    inside, around = regions(PHANTOM, Pose(0, 50, 0), Imaging())
    body, head, leg = np.pi * 12**2, np.pi * 6**2, np.pi * 4**2
    whole = body + head - lens(12, 6) + 4 * (leg - lens(12, 4))
    assert inside.sum() == pytest.approx(whole, rel=0.01)  # of pixels of 1 mm^2
    assert np.array_equal(inside, inside[:, ::-1])
    assert np.flatnonzero(inside.any(axis=1))[[0, -1]].tolist() == [27, 63]
    assert not (inside & around).any() and np.array_equal((inside | around).all(axis=1), inside.any(axis=1))
    aside, _ = regions(PHANTOM, Pose(5, 50, 0), Imaging())
    assert np.array_equal(aside[:, :-5], inside[:, 5:])
    across, _ = regions(PHANTOM, Pose(0, 50, 90), Imaging())
    assert across.sum() == pytest.approx(body + head - lens(12, 6), rel=0.01)  # no legs
    assert not regions(PHANTOM, Pose(0, 50, 0), Imaging(height_px=20))[0].any()


def test_gymnasium_and_sb3_check_the_environment_without_a_warning(grey):
    from stable_baselines3.common.env_checker import check_env as sb3_check_env

    check_env(gym.make(ENV_ID, render_mode="rgb_array", noise=0.25).unwrapped)
    sb3_check_env(gym.make(ENV_ID, noise=0.25))


def test_actions_turn_one_knob_each_and_stop_at_its_end(grey):
    env = ImagingSetupEnv()
    names = ("focal_depth_mm", "frequency_khz", "dynamic_range_db")
    start, steps = (50, 4_000, 60), (10, 1_000, 10)
    for action in range(1, 7):
        env.reset(options=dict(zip(names, start, strict=True)))
        knob, sign = divmod(action - 1, 2)
        expected = list(start)
        expected[knob] += steps[knob] * (2 * sign - 1)
        info = env.step(action)[4]
        assert [info[name] for name in names] == expected and info["x_mm"] == info["angle_deg"] == 0
        for _ in range(9):
            info = env.step(action)[4]
        ends = getattr(IMAGING_SETUP.limits, names[knob])
        assert info[names[knob]] == ends[sign]


def test_the_reward_is_the_quality_of_the_frame_that_the_action_gives(grey):
    env = ImagingSetupEnv()
    env.reset(options={"focal_depth_mm": 40, "frequency_khz": 3_000, "dynamic_range_db": 40})
    frame, reward, terminated, truncated, info = env.step(2)
    assert reward == contrast_to_noise(frame[:, :, 0], *regions(PHANTOM, env.pose, Imaging()))
    assert info["contrast_to_noise"] == reward and info["is_success"] == (reward >= GOOD)
    assert (terminated, truncated, info["distance_mm"]) == (False, False, 0.0)
    assert env.step(2)[1] > reward  # towards 60 mm
    env.reset(options={"focal_depth_mm": 80, "frequency_khz": 5_000, "dynamic_range_db": 90})
    _, reward, _, _, info = env.step(0)
    assert reward < GOOD and not info["is_success"]


def test_a_slip_turns_one_knob_by_one_step(grey):
    env = ImagingSetupEnv(noise=1.0)
    env.reset(seed=1)
    slips = set()
    for _ in range(150):
        env.reset(options={"focal_depth_mm": 50, "frequency_khz": 4_000, "dynamic_range_db": 50})
        slips |= set(env.step(0)[4]["noise"].items())
    assert slips == {
        ("focal_depth_mm", -10), ("focal_depth_mm", 10), ("frequency_khz", -1_000), ("frequency_khz", 1_000),
        ("dynamic_range_db", -10), ("dynamic_range_db", 10),
    }  # fmt: skip
    env.reset(options={"focal_depth_mm": 30, "frequency_khz": 2_000, "dynamic_range_db": 20})
    seen = [tuple(env.step(0)[4]["noise"].values()) for _ in range(40)]
    assert (0,) in seen  # a knob at its end does not turn


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"frequency_khz": 1_000}, "frequency_khz must be in .2000, 5000., not 1000"),
        ({"dynamic_range_db": 95}, "dynamic_range_db must be in .20, 90., not 95"),
        ({"dynamic_range": 60}, "unknown option 'dynamic_range' .did you mean 'dynamic_range_db'"),
    ],
)
def test_starts_that_cannot_be_are_refused(options, said, grey):
    with pytest.raises(ValueError, match=said):
        ImagingSetupEnv().reset(options=options)


def test_other_tasks_have_no_settings(coded):
    with pytest.raises(ValueError, match="unknown option 'frequency_khz'"):
        gym.make("usbench/FocalPoint-v0").reset(options={"frequency_khz": 3_000})


@pytest.mark.parametrize("kind", ["paper", "image"])
def test_there_is_one_kind_of_reward(kind):
    with pytest.raises(ValueError, match=f"task 'setup' has the reward 'normalized' alone, not '{kind}'"):
        ImagingSetupEnv(reward=kind)
    with pytest.raises(ValueError, match=f"task 'setup' has the reward 'normalized' alone, not '{kind}'"):
        returns("setup", reward=kind)
    with pytest.raises(
        ConfigurationError, match=f"task 'setup' has the reward 'normalized' alone, not '{kind}'"
    ):
        resolve("vpg", "setup", reward=kind)


def test_a_trial_records_the_tissue():
    phantom = resolve("vpg", "setup").environment["phantom"]
    assert phantom["attenuation_db_per_cm_mhz"] == 0.5 and phantom["object_of_interest"]["contrast"] == 0
    assert "attenuation_db_per_cm_mhz" not in resolve("vpg", "pp").environment["phantom"]


def test_states_are_all_that_the_knobs_can_reach():
    task = IMAGING_SETUP
    assert len(set(task.states)) == 6 * 4 * 8
    for state in task.states:
        for move in (*(action.move for action in task.actions), *task.displacements):
            assert state.moved(move, task.limits) in task.indices
    assert task.actions[0].move == Move()


@pytest.mark.parametrize(("noise", "n_steps"), [(0.0, 3), (0.3, 2)])
def test_anchors_agree_with_brute_force(noise, n_steps):
    # A corner of the task, with rewards that have no order.
    limits = Limits(focal_depth_mm=(50, 60), frequency_khz=(2_000, 3_000), dynamic_range_db=(40, 50))
    corner = tuple(
        state
        for state in IMAGING_SETUP.states
        if all(
            low <= getattr(state, name) <= high
            for name, (low, high) in vars(limits).items()
            if name != "x_mm"
        )
    )
    values = dict(zip(corner, np.random.default_rng(5).normal(size=len(corner)), strict=True))
    small = dataclasses.replace(
        IMAGING_SETUP, states=corner, starts=corner[::3], limits=limits, n_steps=n_steps,
        reward=lambda pose, target, kind: values[pose],
    )  # fmt: skip
    found = returns(small, noise, rewards=[values[state] for state in corner])
    for anchor, choose in ((found.optimal, max), (found.random, np.mean), (found.stay, lambda q: q[0])):
        expected = np.mean([expectimax(small, pose, n_steps, noise, choose) for pose in small.starts])
        assert anchor == pytest.approx(expected, abs=1e-12)


def test_the_oracle_earns_its_value_in_the_environment(task):
    env = ImagingSetupEnv()
    best = policy(task, rewards=env.state_rewards())
    for start in task.starts[::41]:
        _, info = env.reset(options=dataclasses.asdict(start))
        earned = 0.0
        for step in range(16):
            action = best.action(step, tuple(info[name] for name in task.coordinates))
            _, reward, _, _, info = env.step(action)
            earned += reward
        assert env.pose == Setup(0, 60, 0, frequency_khz=3_000, dynamic_range_db=40)
        assert earned == pytest.approx(best.value(0, start))


def test_a_phantom_of_ones_own_is_judged_by_its_own_frames(monkeypatch):
    asked = []

    def store(phantom, *_):
        asked.append(phantom)
        return GreyFrames()

    monkeypatch.setattr("usbench.envs.guidance.frame_store", store)
    own = Phantom(seed=7, attenuation_db_per_cm_mhz=0.7)
    env = ImagingSetupEnv(phantom=own)
    env.reset(seed=0)
    env.step(1)
    assert set(asked) == {own} and env.target == own.target
    assert ImagingSetupEnv().phantom == PHANTOM


def test_rewards_of_all_states_are_those_of_the_environments_own_frames(grey):
    env, own = ImagingSetupEnv(), ImagingSetupEnv(imaging=Imaging(width_px=38, height_px=88))
    monkey = env.state_rewards()
    for state in IMAGING_SETUP.states[::37]:
        env.reset(options=dataclasses.asdict(state))
        assert env.step(0)[1] == monkey[IMAGING_SETUP.indices[state]]
    with pytest.raises(TypeError, match="ask its environment"):
        IMAGING_SETUP.reward(Pose(), TARGET, "normalized")
    with pytest.raises(ValueError, match="needs 192 rewards, one of each of its states, not 3"):
        returns("setup", rewards=[0.0, 1.0, 2.0])
    assert own.observation_space.shape == (88, 38, 1)


def test_the_anchors_of_another_phantom_are_its_own(monkeypatch):
    """They once were those of the task's own phantom, whatever was examined."""

    class Brighter(GreyFrames):
        def frame(self, pose):
            return np.clip(1.5 * super().frame(pose), 0, 255).astype(np.uint8)

    stores = {PHANTOM: GreyFrames(), Phantom(seed=7): Brighter()}
    monkeypatch.setattr("usbench.envs.guidance.frame_store", lambda phantom, *_: stores[phantom])
    usual, other = ImagingSetupEnv(), ImagingSetupEnv(phantom=Phantom(seed=7))
    found = [returns("setup", rewards=env.state_rewards()) for env in (usual, other)]
    assert found[0] != found[1]


@pytest.mark.parametrize(
    ("probe", "said"),
    [
        (
            LinearArray(center_frequency=3e6, sampling_frequency=25e6),
            "the task 'setup' sets the probe to 5 MHz: sampling_frequency must be at least 7 times "
            "center_frequency (3.5e+07 Hz), not 2.5e+07.",
        ),
        (
            LinearArray(element_width=6e-6, kerf=0.0),
            "the task 'setup' sets the probe to 2 MHz: element_width + kerf must be between a hundredth of a "
            "wavelength and ten ([7.7e-6, 0.0077] m at 2e6 Hz), not 6e-6.",
        ),
    ],
)
def test_a_probe_that_the_task_cannot_set_to_all_its_frequencies_is_refused(probe, said):
    with pytest.raises(ConfigurationError) as refused:
        make_env("setup", probe=probe)
    assert str(refused.value) == said


def test_an_image_that_ends_above_the_object_is_refused():
    with pytest.raises(ValueError, match="and an image 20 mm deep and 40 mm wide does not"):
        gym.make("usbench/ImagingSetup-v1", imaging=Imaging(height_px=20))


def test_both_versions_are_the_same_task_with_another_receiver():
    latest = gym.make(ENV_ID).unwrapped
    with pytest.warns(DeprecationWarning, match="out of date"):  # which Gymnasium says of itself
        first = gym.make("usbench/ImagingSetup-v0").unwrapped
    assert (type(latest), type(first)) == (ImagingSetupEnv, ImagingSetupV0Env)
    assert latest.imaging == IMAGING == Imaging(noise_db=40.0, tgc_db_per_cm=3.0)
    assert first.imaging == Imaging() and first.phantom == latest.phantom
    own = dataclasses.replace(IMAGING_SETUP_V0, name=IMAGING_SETUP.name, title=IMAGING_SETUP.title)
    assert own == IMAGING_SETUP
    # An imaging of one's own stands in place of all of the task's.
    assert ImagingSetupEnv(imaging=Imaging(height_px=80)).imaging.noise_db is None


def test_info_and_records_hold_the_measures_of_the_final_frame(grey):
    reported = []
    env = Recorder(gym.make(ENV_ID), reported.append)
    env.reset(seed=0)
    for _ in range(16):
        frame, reward, _, _, info = env.step(1)
    masks = regions(PHANTOM, env.unwrapped.pose, Imaging())
    assert info["gcnr"] == generalized_contrast_to_noise(frame[:, :, 0], *masks) > 0
    assert info["contrast_order"] == contrast_order(frame[:, :, 0], *masks) < 0
    row = Episode(episode=0, step=16, **{k: v for k, v in reported[0].items() if k != "actions"}).as_row()
    assert (row["final_contrast_to_noise"], row["final_gcnr"]) == (reward, info["gcnr"])
    assert row["final_contrast_order"] == info["contrast_order"] and "measures" not in row
    assert list(row)[-3:] == ["final_contrast_to_noise", "final_gcnr", "final_contrast_order"]


def test_trials_of_the_first_version_are_read_as_such():
    """They are called `setup`, as the latest version is now."""
    latest, first = resolve("dqn", "setup"), resolve("dqn", "setup-v0")
    assert latest.environment["id"] == ENV_ID and latest.environment["imaging"]["noise_db"] == 40.0
    assert first.environment["id"] == "usbench/ImagingSetup-v0"
    assert not {"noise_db", "tgc_db_per_cm"} & set(first.environment["imaging"])
    recorded = Setting.recorded(dataclasses.replace(first, task="setup"))
    assert recorded == Setting(task="setup-v0") and recorded.imaging == Imaging()
    assert Setting.recorded(latest) == Setting(task="setup") and latest.hash != first.hash


def qualities(env):
    """Quality of the simulator's frames of all settings, (4 frequencies, 6 depths, 8 ranges)."""
    return env.state_rewards().reshape(4, 6, 8)


# Of the latest version a range that shows the noise shows all that there is: a wider one is as good, to 0.01.
@pytest.mark.slow
@pytest.mark.parametrize(
    ("env", "best", "plateau"),
    [
        (ImagingSetupEnv, Setup(0, 50, 0, frequency_khz=3_000, dynamic_range_db=30), 0.01),
        (ImagingSetupV0Env, Setup(0, 60, 0, frequency_khz=3_000, dynamic_range_db=40), 0.0),
    ],
)
def test_every_setting_has_its_best_value_in_between(env, best, plateau):
    quality = qualities(env())
    places = np.unravel_index(quality.argmax(), quality.shape)
    assert IMAGING_SETUP.states[quality.argmax()] == best
    for axis, place in enumerate(places):
        along = np.moveaxis(quality, axis, 0)[(slice(None), *np.delete(places, axis))]
        assert 0 < place < len(along) - 1
        # And no other hill: an agent that follows the gradient arrives.
        assert (np.diff(along[: place + 1]) > 0).all() and (np.diff(along[place:]) < plateau).all()


def test_rewards_from_frames_are_read_only(grey):
    task = dataclasses.replace(IMAGING_SETUP, title="rewards that no other test has asked for")
    with pytest.raises(ValueError, match="read-only"):
        DecisionProcess(task).state_rewards[:] *= 2


@pytest.mark.slow
def test_without_noise_the_more_is_lost_the_wider_must_be_what_is_shown():
    ranges = [by_depth.max(axis=0).argmax() for by_depth in qualities(ImagingSetupV0Env())]
    assert ranges == sorted(ranges) and ranges[0] < ranges[-1]


@pytest.mark.slow
def test_noise_keeps_the_highest_frequency_from_being_the_best():
    """With the same gain and without noise the highest frequency would show the cyst best."""
    gain = dataclasses.replace(IMAGING, noise_db=None)
    quiet, noisy = (
        qualities(env).max(axis=(1, 2)) for env in (ImagingSetupEnv(imaging=gain), ImagingSetupEnv())
    )
    assert quiet.argmax() == 3 and noisy.argmax() == 1 and noisy[3] < 0.6 * quiet[3]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "anchors"),
    [("setup", (39.1315, 25.9382, 25.2989)), ("setup-v0", (34.4884, 22.6652, 22.5036))],
)
def test_anchors_are_those_that_the_docs_tell(name, anchors):
    """Those of the first version are what they were before the second one existed."""
    found = dataclasses.astuple(Setting(task=name).anchors())
    assert found == pytest.approx(anchors, abs=5e-5)


@pytest.mark.slow
def test_an_agent_learns_it(tmp_path):
    config = resolve("dqn", "setup", steps=4_096)
    trial = runner.run_trial(config, tmp_path).folder
    from usbench import records

    rows = records.load(trial)
    last = rows[(rows["checkpoint"] == 4_096) & rows["deterministic"]]
    assert last["normalized_score"].mean() > 0.6
