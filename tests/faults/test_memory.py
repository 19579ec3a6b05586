"""Memory stays flat, over the length of a trial and over many trials in one process."""

import dataclasses
from pathlib import Path

import children
import numpy as np
import pytest
import trials

pytestmark = [
    pytest.mark.faults,
    pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="needs /proc"),
]


def growth_mb(configs, out):
    """From the second quarter to the last; the first is the time when everything is made."""
    path = out / "sizes"
    assert children.finish(children.measured, configs, out / "runs", path) == 0
    sizes = np.array(path.read_text().split(), float)
    quarter = len(sizes) // 4
    return sizes[-quarter:].max() - sizes[quarter : 2 * quarter].max()


@pytest.mark.parametrize("algo", ["a2c", "dqn"])
def test_memory_of_a_long_trial_is_flat(algo, tmp_path):
    config = trials.config(algo, steps=2000)
    # A checkpoint before every rollout; a replay buffer that is full in the first quarter.
    if algo == "dqn":
        small = {**config.hyperparameters, "buffer_size": 400}
        config = dataclasses.replace(config, hyperparameters=small)
    assert growth_mb([config], tmp_path) < 8


def test_memory_of_many_trials_in_one_process_is_flat(tmp_path):
    assert growth_mb([trials.config("a2c", seed=seed, steps=16) for seed in range(16)], tmp_path) < 8
