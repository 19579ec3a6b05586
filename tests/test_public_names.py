"""The names at the top of the package: there, light to import, and each from its own module."""

import subprocess
import sys

import pytest

import usbench


def run(code):
    return subprocess.run(
        [sys.executable, "-P", "-c", code], check=True, capture_output=True, text=True
    ).stdout.split()


def test_importing_the_package_is_light():
    seconds, *loaded = run(
        "import sys, time; start = time.process_time(); import usbench; print(time.process_time() - start)\n"
        "print(*{'torch', 'matplotlib', 'numba', 'pandas', 'scipy'} & set(sys.modules))"
    )
    assert float(seconds) < 1.0 and loaded == []


@pytest.mark.parametrize("name", usbench.__all__)
def test_every_public_name_is_there(name):
    assert getattr(usbench, name).__name__ == name
    assert name in dir(usbench)


def test_what_is_not_public_is_no_attribute():
    with pytest.raises(AttributeError, match="no attribute 'fly'"):
        usbench.fly  # noqa: B018


def test_trials_are_loaded_from_the_top(finished):
    trial = usbench.load_trial(finished)
    assert usbench.load_trials(finished.parent) == [trial]
    assert trial.status == "finished" and len(trial.evaluations())
    assert usbench.load_agent(finished).config == trial.config


def test_an_environment_is_made_from_the_top(quick):
    env = usbench.make_env("pp", noise=0.5, n_frames=2, imaging=usbench.Imaging(height_px=64, width_px=64))
    assert env.observation_space.shape == (64, 64, 2)
