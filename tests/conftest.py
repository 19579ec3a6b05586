"""Quick trials: frames drawn instead of simulated, and a handful of evaluation episodes."""

import gc
import importlib.util
import os
import shutil
import signal
from pathlib import Path

import pytest
from quick_trials import speed_up

# Shells start what runs in the background deaf to Ctrl-C, and some tests send one.
signal.signal(signal.SIGINT, signal.default_int_handler)
# Trials are trained on the CPU wherever they are, and so are the agents that tests make by themselves.
os.environ["CUDA_VISIBLE_DEVICES"] = ""
# Figures are compared to the byte, whatever style the user's own matplotlibrc has.
(_MATPLOTLIB,) = importlib.util.find_spec("matplotlib").submodule_search_locations
os.environ["MATPLOTLIBRC"] = os.path.join(_MATPLOTLIB, "mpl-data", "matplotlibrc")


def pytest_collection_finish():
    """Leave out of all garbage collection what is imported by now: every trial ends with one."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def _cache(tmp_path_factory):
    """Every test and every process that it starts share one folder of frames, never the user's."""
    root = tmp_path_factory.getbasetemp()
    # The processes among which the tests are shared out have a folder each beside those of the others.
    root = root.parent if "PYTEST_XDIST_WORKER" in os.environ else root
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.setenv("USBENCH_CACHE", str(root / "cache"))
        yield


@pytest.fixture
def quick(monkeypatch):
    """Quick trials for this test."""
    speed_up(monkeypatch)


@pytest.fixture(scope="session")
def _trial(tmp_path_factory):
    from usbench.trials import runner
    from usbench.trials.configuration import resolve

    with pytest.MonkeyPatch.context() as monkeypatch:
        speed_up(monkeypatch)
        config = resolve("vpg", "pp", steps=128, noise=0.5)
        return runner.run_trial(config, tmp_path_factory.mktemp("runs")).folder


@pytest.fixture
def finished(quick, tmp_path, _trial):
    """The folder of a finished trial (vpg on pp, noise 0.5, 128 steps), a copy for this test alone."""
    return Path(shutil.copytree(_trial, tmp_path / "runs" / _trial.name))


@pytest.fixture(scope="session")
def trial_on(tmp_path_factory):
    """`trial_on(task)`, in a quick test: the folder of a finished trial (vpg, noise 0.25, 64 steps)."""
    from usbench.trials import runner
    from usbench.trials.configuration import resolve

    done = {}

    def folder(task):
        if task not in done:
            config = resolve("vpg", task, steps=64, noise=0.25)
            done[task] = runner.run_trial(config, tmp_path_factory.mktemp("runs")).folder
        return done[task]

    return folder


@pytest.fixture(scope="session")
def undisturbed(tmp_path_factory):
    """`undisturbed(algo)`, in a quick test: a trial that nothing interrupted, with few resume files."""
    import trials

    from usbench.trials import resume_files, runner

    done = {}

    def folder(algo):
        if algo not in done:
            with pytest.MonkeyPatch.context() as monkeypatch:
                monkeypatch.delenv(resume_files.INTERVAL, raising=False)
                done[algo] = runner.run_trial(trials.config(algo), tmp_path_factory.mktemp(algo)).folder
        return done[algo]

    return folder


@pytest.fixture
def often(quick, monkeypatch):
    """A resume file before every rollout."""
    from usbench.trials import resume_files

    monkeypatch.setenv(resume_files.INTERVAL, "0")
