"""Small trials of every algorithm, how tests end them, and which of their results must have the same bits."""

import pytest
import torch
from state_files import read_state

from usbench import records
from usbench.agents import zoo
from usbench.trials import callback, runner
from usbench.trials.configuration import resolve

LEARNERS = [algo for algo, row in zoo.ZOO.items() if row.learns and not row.needs]
STEPS = 64
# So small that every algorithm makes updates within these steps.
SMALL = {
    "vpg": {"n_steps": 16},
    "a2c": {"n_steps": 16},
    "ppo": {"n_steps": 16, "batch_size": 8, "n_epochs": 2},
    "dqn": {"learning_starts": 12, "train_freq": 6, "target_update_interval": 20},
    "double_dqn": {"learning_starts": 12, "train_freq": 4, "batch_size": 16},
    "ppo_asymmetric": {"n_steps": 16, "batch_size": 8, "n_epochs": 2},
    "qrdqn": {"learning_starts": 12, "train_freq": 6, "target_update_interval": 20},
    "trpo": {"n_steps": 16, "batch_size": 8},
    "recurrent_ppo": {"n_steps": 16, "batch_size": 8, "n_epochs": 2},
}
# What may differ between two runs of the same trial.
TIMES = ("started", "timings")


def config(algo, steps=STEPS, seed=0, n_envs=1):
    overrides = SMALL.get(algo)
    return resolve(algo, "pp", noise=0.5, seed=seed, steps=steps, n_envs=n_envs, overrides=overrides)


def bits(folder):
    """Everything that a finished trial must have to the bit: records, story, weights, optimizers."""
    state = read_state(folder)
    model = zoo.model_class(state["config"]["algo"]).load(folder / records.MODEL, device="cpu")
    journals = [(folder / name).read_bytes() for name in (records.EPISODES, records.EVALUATIONS)]
    story = {key: value for key, value in state.items() if key not in TIMES}
    return journals, story, model.num_timesteps, list(_numbers(model.get_parameters()))


def _numbers(value):
    if isinstance(value, torch.Tensor):
        yield value.numpy().tobytes()
    elif isinstance(value, dict):
        for key, item in value.items():
            yield str(key)
            yield from _numbers(item)
    elif isinstance(value, list | tuple):
        for item in value:
            yield from _numbers(item)
    else:
        yield value


ENDED_AT = 44
# A trial reports its progress after whole episodes.
FIRST_TOLD = 16


class Killed(BaseException):
    """Stands for SIGKILL: nothing in the project catches it (tests/faults sends the real one)."""


class Until(callback.Silent):
    """Ends a trial at a step, and keeps the first step that the trial reported."""

    def __init__(self, step=None, error=Killed):
        self.step, self.error, self.first = step, error, None

    def training(self, now, *_):
        self.first = self.first or now
        if now == self.step:
            raise self.error


def killing(*_):
    raise Killed


def ended(out, algo="vpg", step=ENDED_AT, error=Killed):
    """Run a trial up to a step; return its folder."""
    with pytest.raises(error):
        runner.run_trial(config(algo), out, progress=Until(step, error))
    return out / config(algo).folder_name


def go_on(folder, algo="vpg"):
    """Run the trial to its end; return the first step that the trial reported."""
    progress = Until()
    assert not runner.run_trial(config(algo), folder.parent, progress=progress).skipped
    return progress.first


def diverge(monkeypatch, algo):
    """Let an update leave weights that are no numbers."""

    def train(agent, *_, **__):
        for weights in agent.policy.parameters():
            weights.data.fill_(torch.nan)

    monkeypatch.setattr(zoo.model_class(algo), "train", train)
