"""Trials from end to end, on drawn frames: what they record, that they repeat, and how they end."""

import dataclasses
import json

import numpy as np
import pytest
import torch
import trials
from PIL import Image
from state_files import read_state

from usbench import records, suite
from usbench.agents import zoo
from usbench.agents.vpg import VPG
from usbench.envs.bmode import Imaging
from usbench.records import ConfigurationError
from usbench.records.journal import Journal, read_rows
from usbench.setting import Setting, make_env
from usbench.trials import callback, learning, runner
from usbench.trials.configuration import resolve
from usbench.trials.evaluation import Evaluator
from usbench.watch import replay

STEPS = 128


def run(out, algo="vpg", task="pp", *, overwrite=False, progress=None, **settings):
    config = resolve(algo, task, **{"steps": STEPS, **settings})
    return runner.run_trial(config, out, overwrite=overwrite, progress=progress)


def journals(folder):
    return [(folder / name).read_bytes() for name in (records.EPISODES, records.EVALUATIONS)]


def stop_at(step, error):
    class Stop(callback.Silent):
        def training(self, now, *_):
            if now == step:
                raise error

    return Stop()


def test_finished_trial_has_every_file_and_its_story(finished):
    assert {"trial.json", "episodes.jsonl", "evaluations.jsonl", "model.zip", "tensorboard"} == {
        path.name for path in finished.iterdir()
    }
    state = read_state(finished)
    assert state["status"] == "finished" and state["reason"] is None
    assert set(state["checksums"]) == {"episodes.jsonl", "evaluations.jsonl"}
    assert state["config"]["hyperparameters"]["gae_lambda"] == 0.97
    assert state["frames"]["poses"] == 216 and len(state["frames"]["digest"]) == 64
    assert state["versions"]["torch"].startswith(torch.__version__.split("+")[0])
    assert set(state["timings"]) == {"frames_s", "training_s", "evaluation_s", "total_s"}
    assert min(state["timings"].values()) >= 0


def test_every_training_episode_is_recorded_and_the_budget_is_exact(finished):
    episodes = records.load(finished, "episodes")
    assert list(episodes["step"]) == list(range(16, STEPS + 1, 16))
    assert list(episodes["episode"]) == list(range(STEPS // 16))
    assert VPG.load(finished / "model.zip").num_timesteps == STEPS


def test_checkpoints_and_evaluation_episodes_are_the_suites(finished):
    evaluations = records.load(finished)
    assert sorted(set(evaluations["checkpoint"])) == [0, STEPS // 2, STEPS]
    starts = suite.TASKS["pp"].guidance.starts
    for _, group in evaluations.groupby(["checkpoint", "deterministic"]):
        assert list(group["start_x_mm"]) == [start.x_mm for start in starts]
        assert list(group["start_angle_deg"]) == [start.angle_deg for start in starts]


def test_record_alone_is_enough_to_replay_an_episode(finished):
    for record in read_rows(finished / records.EVALUATIONS)[:3]:
        *_, last = replay.play(Setting(task="pp", noise=0.5), record["eval_episode"], record["actions"])
        assert last.return_ == record["return"]
    path = replay.write_gif(finished)
    with Image.open(path) as animation:
        assert animation.format == "GIF" and animation.n_frames == 17


def test_same_seed_gives_the_same_bytes_and_another_does_not(finished, tmp_path):
    again = run(tmp_path, noise=0.5).folder
    assert again.name == finished.name and journals(again) == journals(finished)
    other = run(tmp_path, noise=0.5, seed=1).folder
    assert journals(other)[0] != journals(finished)[0]


def test_training_does_not_depend_on_evaluation(finished, tmp_path, monkeypatch):
    rows = {name: dataclasses.replace(row, checkpoints=1) for name, row in suite.TASKS.items()}
    monkeypatch.setattr(suite, "TASKS", rows)
    seldom = run(tmp_path, noise=0.5).folder
    assert len(records.load(seldom)) < len(records.load(finished))
    assert journals(seldom)[0] == journals(finished)[0]


@pytest.mark.parametrize("algo", ["random", "stay", "oracle"])
def test_agents_that_do_not_learn_are_evaluated_once(quick, tmp_path, algo):
    folder = run(tmp_path, algo, "fp").folder
    evaluations = records.load(folder)
    assert set(evaluations["checkpoint"]) == {0}
    assert records.load(folder, "episodes").empty
    assert read_state(folder)["config"]["steps"] == 0


def test_evaluation_seeds_never_meet_training_seeds():
    seeds = [episode.seed for task in suite.TASKS for episode in suite.evaluation_episodes(task)]
    assert min(seeds) >= 2**32


def test_evaluation_leaves_every_generator_as_it_was(quick):
    env = make_env("pp")
    model = VPG("CnnPolicy", env, device="cpu", seed=0)

    def states():
        own = [space.np_random.bit_generator.state for space in (env.action_space, model.action_space)]
        return repr((np.random.get_state(), own)), torch.get_rng_state()

    before = states()
    setting = Setting(task="pp", noise=0.5, n_frames=4)
    first, second = (
        Evaluator(setting, setting.evaluation_episodes()).play(
            model, checkpoint=0, step=0, deterministic=False
        )
        for _ in range(2)
    )
    assert first == second
    after = states()
    assert before[0] == after[0] and torch.equal(before[1], after[1])


@pytest.mark.parametrize("algo", ["dqn", "qrdqn"])
def test_value_based_agents_explore_in_each_episode_by_itself(quick, algo):
    env = make_env("pp")
    agent = zoo.make(algo, env, 0, {**zoo.hyperparameters(algo, "pp"), "buffer_size": 100})
    setting = Setting(task="pp", noise=0.0, n_frames=4)
    evaluator = Evaluator(setting, setting.evaluation_episodes())

    def first_actions(deterministic):
        played = evaluator.play(agent, checkpoint=0, step=0, deterministic=deterministic)
        return np.array([episode.actions[0] for episode in played])

    greedy = first_actions(True)
    for rate, least, most in ((0.0, 0, 0), (0.5, 1, len(greedy) - 1), (1.0, 1, len(greedy))):
        agent.exploration_rate = rate
        assert least <= (first_actions(False) != greedy).sum() <= most
    assert (first_actions(False) == first_actions(False)).all()


@pytest.mark.parametrize(("steps", "episodes"), [(10, 0), (100, 6), (STEPS, 8)])
def test_budget_is_exact_where_the_rollout_does_not_divide_it(quick, tmp_path, steps, episodes):
    folder = run(tmp_path, steps=steps).folder
    assert VPG.load(folder / "model.zip").num_timesteps == steps
    assert len(records.load(folder, "episodes")) == episodes
    assert records.load(folder)["checkpoint"].max() == steps


def test_finished_trial_is_not_run_again_unless_asked(finished):
    before = (finished / "trial.json").read_bytes()
    assert run(finished.parent, noise=0.5).skipped
    assert (finished / "trial.json").read_bytes() == before
    assert not run(finished.parent, noise=0.5, overwrite=True).skipped
    assert (finished.parent / f"{finished.name}.earlier-1" / "trial.json").read_bytes() == before


def test_interrupted_trial_keeps_its_state_and_goes_on(finished, tmp_path):
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path, noise=0.5, progress=stop_at(80, KeyboardInterrupt()))
    (folder,) = records.trial_folders(tmp_path)
    assert read_state(folder)["status"] == "interrupted"
    assert len(records.load(folder, "episodes")) == 5
    assert VPG.load(folder / "model.zip").num_timesteps == 80
    again = run(tmp_path, noise=0.5)
    assert not again.skipped and again.folder == folder
    assert journals(folder) == journals(finished)
    assert not list(tmp_path.glob("*.earlier-*"))


def test_failed_trial_says_why_and_keeps_its_records(quick, tmp_path):
    with pytest.raises(runner.TrialError, match="No space left"):
        run(tmp_path, progress=stop_at(80, OSError(28, "No space left on device")))
    (folder,) = records.trial_folders(tmp_path)
    state = read_state(folder)
    assert state["status"] == "failed" and "No space left" in state["reason"]
    assert len(records.load(folder, "episodes")) == 5


@pytest.mark.parametrize("algo", ["vpg", "dqn"])
def test_a_training_that_diverges_fails_and_says_so(algo, quick, tmp_path, monkeypatch):
    # Probabilities that are no numbers raise an error that lists all of them; values go unseen.
    trials.diverge(monkeypatch, algo)
    with pytest.raises(runner.TrialError, match=r"failed: the training diverged: .* smaller learning rate$"):
        run(tmp_path, algo=algo, steps=160, overrides={"learning_starts": 16} if algo == "dqn" else {})
    (folder,) = records.trial_folders(tmp_path)
    assert read_state(folder)["reason"] == records.DIVERGED


def test_trial_whose_agent_cannot_be_made_leaves_no_file_open(quick, tmp_path, monkeypatch):
    opened = []

    class Kept(Journal):
        def __init__(self, path):
            super().__init__(path)
            opened.append(self._file)

    monkeypatch.setattr(learning, "Journal", Kept)
    monkeypatch.setattr(zoo, "make", lambda *_, **__: 1 / 0)
    with pytest.raises(runner.TrialError, match="ZeroDivisionError"):
        run(tmp_path)
    assert len(opened) == 2 and all(file.closed for file in opened)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"algo": "vgp"}, "'vpg'"),
        ({"task": "ppp"}, "'pp'"),
        ({"noise": 1.5}, "noise.*1.5"),
        ({"noise": float("nan")}, "noise.*nan"),
        ({"noise": "much"}, "noise.*'much'"),
        ({"seed": -1}, "seed.*-1"),
        ({"seed": 1.5}, "seed.*1.5"),
        ({"steps": 0}, "steps.*0"),
        ({"steps": 1e16}, "steps must be at most 9007199254740991, not 10000000000000000"),
        ({"steps": -16}, "steps.*-16"),
        ({"steps": 16.5}, "steps.*16.5"),
        ({"steps": True}, "steps.*True"),
        ({"n_frames": 0}, r"n_frames must be a whole number in \[1, 64\], not 0\."),
        ({"n_frames": 65}, r"n_frames must be a whole number in \[1, 64\], not 65\."),
        ({"n_frames": True}, "n_frames.*True"),
        ({"n_frames": "4"}, "n_frames.*'4'"),
        # The network would take the columns for the frames, once the frames are simulated.
        ({"n_frames": 40}, r"n_frames must be a whole number in \[1, 39\], below the rows.*, not 40\."),
        ({"imaging": Imaging(width_px=7)}, "height_px and width_px must be at least 8 for an agent, not 7"),
        ({"preset": "spinnup"}, "'spinup'"),
        ({"overrides": {"gama": "0.9"}}, "'gamma'"),
        ({"overrides": {"gamma": "2.0"}}, "gamma.*2.0"),
        ({"overrides": {"gamma": "high"}}, "gamma.*'high'"),
        ({"overrides": {"n_steps": "64.5"}}, "n_steps.*64.5"),
    ],
)
def test_unusable_settings_are_refused_in_one_sentence(changes, message):
    arguments = {"algo": "vpg", "task": "pp", **changes}
    with pytest.raises(ConfigurationError, match=message) as refusal:
        resolve(**arguments)
    assert "\n" not in str(refusal.value)


def test_resolved_configuration_is_complete_and_plain():
    config = resolve("vpg", "fp", preset="spinup", overrides={"gamma": "0.9"})
    assert config.steps == 16_064 and config.n_frames == 4
    assert config.hyperparameters["n_value_steps"] == 80
    assert config.hyperparameters["gamma"] == 0.9
    assert config.hyperparameters["gae_lambda"] == 0.95
    assert set(config.environment) == {"id", "phantom", "probe", "imaging"}
    plain = dataclasses.asdict(config)
    assert json.loads(json.dumps(plain)) == plain
