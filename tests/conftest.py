"""Quick trials: frames drawn instead of simulated, and a handful of evaluation episodes."""

import dataclasses
import functools
import gc
import hashlib
import shutil
import signal
from pathlib import Path

import numpy as np
import pytest

# Shells start what runs in the background deaf to Ctrl-C, and some tests send one.
signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_finish():
    """Leave out of all garbage collection what is imported by now: every trial ends with one."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def _cache(tmp_path_factory):
    """Every test and every process that it starts share one folder of frames, never the user's."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.setenv("USBENCH_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


QUICK_CHECKPOINTS = 2


class DrawnFrames:
    """Stands in for the simulator: a bright spot whose place and width tell the pose."""

    def frame(self, pose):
        x, z = np.arange(40)[np.newaxis] - 19.5, np.arange(90)[:, np.newaxis]
        width = 3 + 9 * abs(np.cos(np.radians(pose.angle_deg)))
        spot = np.exp(-(((x + pose.x_mm) / width) ** 2) - ((z - pose.focal_depth_mm) / 10) ** 2)
        return (20 + 200 * spot).astype(np.uint8)

    def prepare(self, poses, progress=None):
        for done in range(len(poses)):
            if progress is not None:
                progress(done + 1, len(poses))

    def digest(self, poses):
        return hashlib.sha256(b"".join(self.frame(pose).tobytes() for pose in poses)).hexdigest()


def speed_up(monkeypatch):
    """Make trials take a second or two."""
    # Here, so that the tests of the physics do not wait for the rest.
    from usbench import suite
    from usbench.envs import oracle

    frames = DrawnFrames()
    for name in ("_returns", "_policy", "_rewards"):  # which may be of the simulator's frames
        plain = getattr(oracle, name).__wrapped__
        monkeypatch.setattr(oracle, name, functools.lru_cache(maxsize=256)(plain))
    monkeypatch.setattr("usbench.envs.guidance.frame_store", lambda *_: frames)
    monkeypatch.setattr("usbench.envs.imaging_setup.frame_store", lambda *_: frames)
    monkeypatch.setattr("usbench.runner.frame_store", lambda *_: frames)
    monkeypatch.setattr("usbench.board.frame_store", lambda *_: frames)
    if suite.TASKS["pp"].checkpoints != QUICK_CHECKPOINTS:  # fixtures may ask for it within each other
        rows = {name: _with_fewer_evaluations(row) for name, row in suite.TASKS.items()}
        monkeypatch.setattr(suite, "TASKS", rows)


def _with_fewer_evaluations(row):
    guidance = dataclasses.replace(row.guidance, starts=row.guidance.starts[::7])
    few = {"drawn_starts": min(row.drawn_starts, 4), "phantoms": min(row.phantoms, 3)}
    return dataclasses.replace(row, repeats=1, checkpoints=QUICK_CHECKPOINTS, guidance=guidance, **few)


@pytest.fixture
def quick(monkeypatch):
    """Quick trials for this test."""
    speed_up(monkeypatch)


@pytest.fixture(scope="session")
def _trial(tmp_path_factory):
    from usbench import runner

    with pytest.MonkeyPatch.context() as monkeypatch:
        speed_up(monkeypatch)
        config = runner.resolve("vpg", "pp", steps=128, noise=0.5)
        return runner.run_trial(config, tmp_path_factory.mktemp("runs")).folder


@pytest.fixture
def finished(quick, tmp_path, _trial):
    """The folder of a finished trial (vpg on pp, noise 0.5, 128 steps), a copy for this test alone."""
    return Path(shutil.copytree(_trial, tmp_path / "runs" / _trial.name))


@pytest.fixture(scope="session")
def trial_on(tmp_path_factory):
    """`trial_on(task)`, in a quick test: the folder of a finished trial (vpg, noise 0.25, 64 steps)."""
    from usbench import runner

    done = {}

    def folder(task):
        if task not in done:
            config = runner.resolve("vpg", task, steps=64, noise=0.25)
            done[task] = runner.run_trial(config, tmp_path_factory.mktemp("runs")).folder
        return done[task]

    return folder


@pytest.fixture(scope="session")
def undisturbed(tmp_path_factory):
    """`undisturbed(algo)`, in a quick test: a trial that nothing happened to, its checkpoints far apart."""
    import trials

    from usbench import checkpoints, runner

    done = {}

    def folder(algo):
        if algo not in done:
            with pytest.MonkeyPatch.context() as monkeypatch:
                monkeypatch.delenv(checkpoints.INTERVAL, raising=False)
                done[algo] = runner.run_trial(trials.config(algo), tmp_path_factory.mktemp(algo)).folder
        return done[algo]

    return folder


@pytest.fixture
def often(quick, monkeypatch):
    """A checkpoint before every rollout."""
    from usbench import checkpoints

    monkeypatch.setenv(checkpoints.INTERVAL, "0")
