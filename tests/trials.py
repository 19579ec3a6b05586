"""Small trials of every algorithm, and what of them must have the same bits."""

import json

import torch

from usbench import records, runner
from usbench.agents import zoo

LEARNERS = [algo for algo, row in zoo.ZOO.items() if row.learns]
STEPS = 64
# So small that all of them have learned from something within these steps.
SMALL = {
    "vpg": {"n_steps": 16},
    "a2c": {"n_steps": 16},
    "ppo": {"n_steps": 16, "batch_size": 8, "n_epochs": 2},
    "dqn": {"learning_starts": 12, "train_freq": 6, "target_update_interval": 20},
    "qrdqn": {"learning_starts": 12, "train_freq": 6, "target_update_interval": 20},
    "trpo": {"n_steps": 16, "batch_size": 8},
    "recurrent_ppo": {"n_steps": 16, "batch_size": 8, "n_epochs": 2},
}
# What may differ between two runs of the same trial.
TIMES = ("started", "timings")


def config(algo, steps=STEPS, seed=0):
    return runner.resolve(algo, "pp", noise=0.5, seed=seed, steps=steps, overrides=SMALL.get(algo))


def bits(folder):
    """Everything that a finished trial must have to the bit: records, story, weights, optimizers."""
    algo = records.read_state(folder)["config"]["algo"]
    model = zoo.model_class(algo).load(folder / records.MODEL, device="cpu")
    state = json.loads((folder / records.TRIAL).read_text())
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
