"""Every algorithm meets the same: starts, noise and evaluation episodes at one seed, and an exact budget."""

from functools import partial

import numpy as np
import pytest
import sweep_worker
from stable_baselines3.common.vec_env import DummyVecEnv

from usbench import records
from usbench.agents import zoo
from usbench.setting import Setting
from usbench.trials import callback, evaluation, learning, runner
from usbench.trials.configuration import resolve

LEARNERS = [algo for algo, row in zoo.ZOO.items() if row.learns and not row.needs]
STEPS = 96
# So small that all of them have learned from something within these steps.
SMALL = {
    "vpg": {"n_steps": 32},
    "vpg-tuned": {"n_steps": 32},
    "a2c": {"n_steps": 32},
    "ppo": {"n_steps": 32, "batch_size": 32, "n_epochs": 1},
    "dqn": {"learning_starts": 32, "train_freq": 16},
    "double_dqn": {"learning_starts": 32, "train_freq": 16},
    "ppo_asymmetric": {"n_steps": 32, "batch_size": 32, "n_epochs": 1},
    "qrdqn": {"learning_starts": 32, "train_freq": 16},
    "trpo": {"n_steps": 32, "batch_size": 32},
    "recurrent_ppo": {"n_steps": 32, "batch_size": 32, "n_epochs": 1},
}


def train(algo, out, monkeypatch, steps=STEPS):
    """Run a trial; return its folder and, for each training step, the noise that it met."""
    displacements = []
    real = evaluation.Recorder.step

    def step(self, action):
        result = real(self, action)
        if self.training:
            displacements.append(result[4]["noise"])
        return result

    def init(self, env, report):
        original(self, env, report)
        self.training = not isinstance(report, partial)  # which an evaluation has

    original = evaluation.Recorder.__init__
    with monkeypatch.context() as patch:
        patch.setattr(evaluation.Recorder, "__init__", init)
        patch.setattr(evaluation.Recorder, "step", step)
        config = resolve(algo, "pp", noise=0.5, steps=steps, n_envs=1, overrides=SMALL[algo])
        folder = runner.run_trial(config, out).folder
    return folder, displacements


def starts(folder, table):
    keys = ["start_x_mm", "start_focal_depth_mm", "start_angle_deg"]
    return records.load(folder, table)[keys].to_numpy().tolist()


@pytest.fixture(scope="module")
def trials(tmp_path_factory):
    """One short trial of each algorithm at the same seed: folder and noise by name."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        sweep_worker.speed_up(monkeypatch)
        return {algo: train(algo, tmp_path_factory.mktemp(algo), monkeypatch) for algo in LEARNERS}


@pytest.mark.parametrize("algo", LEARNERS)
def test_starts_and_noise_are_those_of_every_other_algorithm(trials, algo):
    folder, noise = trials[algo]
    first, first_noise = trials[LEARNERS[0]]
    assert starts(folder, "episodes") == starts(first, "episodes")
    assert len({tuple(start) for start in starts(folder, "episodes")}) > 1
    for one, other in zip(noise, first_noise, strict=True):
        assert one.keys() == other.keys()
        # A slip that the border blocks is 0, and who is at the border depends on the actions.
        assert all(one[key] == other[key] or 0 in (one[key], other[key]) for key in one)
    assert len(noise) == STEPS and 20 < sum(any(one.values()) for one in noise) < 76


def initial_weights(algo, trial_seed):
    _, seed = learning.seeds_of(trial_seed, algo)
    env = DummyVecEnv([Setting(task="pp").make_env])
    model = zoo.make(algo, env, seed, zoo.hyperparameters(algo, "pp"), device="cpu")
    first = next(part for part in model.policy.parameters() if part.dim() == 4)
    return first.detach().flatten().numpy()


def test_initial_networks_of_one_seed_are_independent(quick):
    weights = {(algo, seed): initial_weights(algo, seed) for algo in LEARNERS for seed in (0, 1)}
    # 576 independent weights: the correlation has a standard deviation of 0.042.
    correlations = np.corrcoef([*weights.values()])[np.triu_indices(len(weights), 1)]
    assert np.abs(correlations).max() < 0.2
    assert (initial_weights("ppo", 0) == weights["ppo", 0]).all()
    assert len({learning.seeds_of(0, algo)[0] for algo in LEARNERS}) == 1


@pytest.mark.parametrize("algo", LEARNERS)
def test_evaluation_episodes_are_the_same_at_every_checkpoint(trials, algo):
    evaluations = records.load(trials[algo][0])
    assert sorted(set(evaluations["checkpoint"])) == [0, STEPS // 2, STEPS]
    first = records.load(trials[LEARNERS[0]][0])
    keys = [
        "checkpoint",
        "deterministic",
        "eval_episode",
        "start_x_mm",
        "start_focal_depth_mm",
        "start_angle_deg",
    ]
    assert evaluations[keys].equals(first[keys])


@pytest.mark.parametrize("algo", LEARNERS)
def test_budget_and_last_checkpoint_are_exact(trials, algo):
    folder, _ = trials[algo]
    evaluations = records.load(folder)
    assert evaluations[evaluations["checkpoint"] == STEPS]["step"].eq(STEPS).all()
    model = zoo.model_class(algo).load(folder / records.MODEL, device="cpu")
    assert model.num_timesteps == STEPS and model._n_updates > 0


@pytest.mark.parametrize("algo", LEARNERS)
def test_evaluating_changes_no_bit_of_training_and_same_seed_gives_the_same(
    trials, algo, quick, tmp_path, monkeypatch
):
    monkeypatch.setattr(callback.TrainingWatch, "evaluate_due", lambda *_: None)
    monkeypatch.setattr(runner._Run, "_reference", lambda *_: {})
    folder, _ = train(algo, tmp_path, monkeypatch)
    assert records.load(folder).empty
    episodes = [(one / records.EPISODES).read_bytes() for one in (folder, trials[algo][0])]
    assert episodes[0] == episodes[1]
    one, other = (
        zoo.model_class(algo).load(path / records.MODEL, device="cpu").policy.state_dict()
        for path in (folder, trials[algo][0])
    )
    assert all(one[name].equal(other[name]) for name in one)


@pytest.mark.parametrize("algo", LEARNERS)
def test_rollout_that_does_not_divide_the_budget_does_not_overrun_it(quick, algo, tmp_path, monkeypatch):
    folder, noise = train(algo, tmp_path, monkeypatch, steps=STEPS - 10)
    assert len(noise) == STEPS - 10
    assert records.load(folder)["step"].max() == STEPS - 10
