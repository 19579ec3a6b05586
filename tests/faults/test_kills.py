"""SIGKILL, SIGTERM and Ctrl-C at random moments: run again, it ends with the bits of an undisturbed run."""

import os
import random
import signal
import time

import children
import pytest
import trials
from state_files import read_state

from usbench import records

pytestmark = pytest.mark.faults

KILLS = 8


def kill(process):
    os.killpg(process.pid, signal.SIGKILL)
    process.join()


@pytest.fixture(scope="module", params=trials.LEARNERS)
def undisturbed(request, tmp_path_factory):
    """A trial that nothing happened to: its configuration, its bits, and its seconds."""
    config, out = trials.config(request.param), tmp_path_factory.mktemp(request.param)
    # The first process waits until everything is imported.
    assert children.finish(children.trial, trials.config("stay", steps=1), out / "first") == 0
    begun = time.monotonic()
    assert children.finish(children.trial, config, out, seconds=45) == 0
    return config, trials.bits(out / config.folder_name), time.monotonic() - begun


def test_trials_killed_at_random_moments(undisturbed, tmp_path):
    config, bits, seconds = undisturbed
    chance, kills, rounds = random.Random(f"kills of {config.algo}"), 0, 0
    while kills < KILLS:
        out, rounds = tmp_path / str(rounds), rounds + 1
        while True:
            process = children.start(children.trial, config, out, seconds=chance.choice([0, 0, 0.1]))
            if kills == KILLS:
                children.ended(process)
            process.join(chance.uniform(0.2, 0.8) * seconds)
            if process.exitcode is not None:
                assert process.exitcode == 0
                break
            kill(process)
            kills += 1
            # Readable at any moment.
            if out.exists():
                records.load(out)
        assert trials.bits(out / config.folder_name) == bits
        assert {path.name for path in out.iterdir()} == {config.folder_name, ".locks"}
    print(f"{config.algo}: {kills} kills, {rounds} trials")


PLANNED = [trials.config(algo, seed=seed) for algo, seed in (("vpg", 0), ("dqn", 0), ("a2c", 1))]


@pytest.fixture(scope="module")
def undisturbed_sweep(tmp_path_factory):
    out = tmp_path_factory.mktemp("sweep")
    begun = time.monotonic()
    assert children.finish(children.many, PLANNED, out, 1, seconds=45) == 0
    return all_bits(out), time.monotonic() - begun


def all_bits(out):
    return [trials.bits(out / config.folder_name) for config in PLANNED]


def test_sweeps_and_their_workers_killed_at_random_moments(undisturbed_sweep, tmp_path):
    bits, seconds = undisturbed_sweep
    chance, kills, pids = random.Random("kills of sweeps"), 0, []
    while True:
        process = children.start(children.many, PLANNED, tmp_path, 2)
        pids.append(process.pid)
        if kills == 4:
            children.ended(process)
        process.join(chance.uniform(0.2, 0.8) * seconds)
        if process.exitcode is not None:
            break
        # Every second time a worker dies first, which the sweep has to notice.
        if kills % 2 and (alive := children.workers(process.pid)):
            os.kill(chance.choice(alive), signal.SIGKILL)
            process.join(0.5)
        if process.exitcode is None:
            os.kill(process.pid, signal.SIGKILL)
            process.join()
        kills += 1
    assert process.exitcode == 0 and kills >= 2
    assert all_bits(tmp_path) == bits
    assert len(list(tmp_path.iterdir())) == len(PLANNED) + 1
    assert not list(tmp_path.rglob("*.part"))
    print(f"sweeps: {kills} kills")
    # Nothing lives on, nor waits to be reaped.
    for _ in range(600):
        left = [left for pid in pids for left in children.session(pid)]
        if not left:
            return
        time.sleep(0.1)
    pytest.fail(f"processes {left} are left")


def test_two_sweeps_at_once_compute_nothing_twice(undisturbed_sweep, tmp_path):
    both = [children.start(children.many, PLANNED, tmp_path, 1) for _ in range(2)]
    assert [children.ended(process) for process in both] == [0, 0]
    assert all_bits(tmp_path) == undisturbed_sweep[0]
    for config in PLANNED:
        # One for each time that an agent began to learn.
        assert len(list((tmp_path / config.folder_name / records.TENSORBOARD).iterdir())) == 1


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("undisturbed", ["vpg", "dqn"], indirect=True)
def test_command_that_is_interrupted_goes_on(undisturbed, tmp_path, number):
    config, bits, _ = undisturbed
    settings = [f"{name}={value}" for name, value in trials.SMALL[config.algo].items()]
    argv = ["run", "--algo", config.algo, "--task", "pp", "--noise", "0.5", "--steps", str(trials.STEPS)]
    argv += ["--quiet", "--out", str(tmp_path), "--set", *settings]
    folder = tmp_path / config.folder_name
    process = children.start(children.command, *argv)
    while not children.is_begun(folder) and process.is_alive():
        time.sleep(0.01)
    os.kill(process.pid, number)
    assert children.ended(process) == 130
    assert read_state(folder)["status"] == "interrupted"
    assert children.finish(children.command, *argv) == 0
    assert trials.bits(folder) == bits
