"""The page of the paper's grid stays below 5 MB: trials that nobody trained, with the frames of the tasks."""

import itertools
import json
from dataclasses import asdict

import numpy as np
import pytest
from stable_baselines3.common.vec_env import DummyVecEnv
from state_files import write_state

from usbench import records, suite
from usbench.agents import zoo
from usbench.envs import oracle
from usbench.report import page
from usbench.setting import make_env
from usbench.trials import configuration

LIMIT_MB = 5
NOISES, SEEDS = (0.0, 0.25, 0.5), range(4)
# Few of each, since a page shows means.
EVALUATIONS, EPISODES = 3, 50


def episode(generator, task, number, step):
    """An episode with another score each time: no line of a figure is straight, which would be short."""
    anchors, pose = oracle.returns(task), suite.evaluation_episodes(task)[number].start
    return records.Episode(
        episode=number,
        step=step,
        return_=anchors.random + generator.uniform() * (anchors.optimal - anchors.random),
        poses={f"start_{name}": value for name, value in asdict(pose).items()}
        | {"final_x_mm": 5 * int(generator.integers(5)), "final_focal_depth_mm": 50, "final_angle_deg": 0},
        final_distance_mm=float(generator.uniform(0, 20)),
        final_sin_angle=float(generator.uniform()),
        is_success=False,
        steps_to_goal=None,
    )


def write(runs, config, model):
    """Write the folder of a trial whose agent did anything; one that learns leaves `model`."""
    # No two trials alike, or lines in figures would cover each other.
    generator = np.random.default_rng(list(config.folder_name.encode()))
    folder = runs / config.folder_name
    folder.mkdir()
    steps = [config.steps * part // EPISODES for part in range(1, EPISODES + 1)] if config.steps else []
    rows = [episode(generator, config.task, 0, step).as_row() for step in steps]
    (folder / records.EPISODES).write_text("".join(f"{json.dumps(row)}\n" for row in rows))
    checkpoints = suite.evaluation_points(config.task, config.steps)
    rows = [
        episode(generator, config.task, number, step).as_row()
        | {"checkpoint": step, "deterministic": deterministic, "eval_episode": number}
        | {"actions": generator.integers(5, size=16).tolist()}
        for step, deterministic, number in itertools.product(checkpoints, (False, True), range(EVALUATIONS))
    ]
    (folder / records.EVALUATIONS).write_text("".join(f"{json.dumps(row)}\n" for row in rows))
    anchors = asdict(oracle.returns(config.task, config.noise))
    state = {"status": "finished", "config": asdict(config), "anchors": anchors}
    timings = {"training_s": 240.0, "total_s": 300.0} if config.steps else {"total_s": 1.0}
    write_state(folder, state | {"timings": timings, "versions": {"numpy": np.__version__}})
    if config.steps:
        (folder / records.MODEL).write_bytes(model)


@pytest.mark.slow
def test_page_of_the_papers_grid_is_small(tmp_path):
    runs = tmp_path / "runs"
    runs.mkdir()
    rows = [(algo, row) for algo, row in zoo.ZOO.items() if row.compared]
    for task, (algo, row) in itertools.product(("fp", "pp"), rows):
        model = b""
        if row.learns:
            config = configuration.resolve(algo, task)
            env = DummyVecEnv([lambda task=task: make_env(task)])
            zoo.make(algo, env, 0, config.hyperparameters, device="cpu").save(tmp_path / "model.zip")
            model = (tmp_path / "model.zip").read_bytes()
        for noise, seed in itertools.product(NOISES, SEEDS if row.learns else (0,)):
            write(runs, configuration.resolve(algo, task, noise=noise, seed=seed), model)
    assert len(records.trial_folders(runs)) == 2 * 3 * (8 * 4 + 3)
    size = page.write(runs, tmp_path / "report.html").stat().st_size
    print(f"{size / 1e6:.2f} MB")
    assert size < LIMIT_MB * 1e6
