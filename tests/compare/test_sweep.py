"""Many trials: what is finished is skipped, accidents stay with one trial, any number of jobs is the same."""

import functools
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import children
import pytest
import sweep_worker
import trials
from state_files import read_state

from usbench import records
from usbench.compare import expected, sweep
from usbench.envs.probe import LinearArray
from usbench.records.lock import is_held, lock_of
from usbench.trials.configuration import resolve


class Notes:
    """A `sweep.Progress` that keeps what it was told."""

    def __init__(self):
        self.started_with, self.ended_with, self.again = None, [], []

    def frames(self, done, total):
        pass

    def started(self, *numbers):
        self.started_with = numbers

    def ended(self, outcome):
        self.ended_with.append(outcome)

    def retried(self, config):
        self.again.append(config.algo)


def here():
    """An executor in this process."""
    return ThreadPoolExecutor(1)


def plan(*algos, seeds=(0,), steps=64):
    return [resolve(algo, "pp", seed=seed, steps=steps, noise=0.5) for seed in seeds for algo in algos]


def run(configs, out, executor=here, jobs=1, notes=None):
    return sweep.run(configs, out, notes or Notes(), jobs=jobs, executor=executor)


def journals(out):
    return {(path.parent.name, path.name): path.read_bytes() for path in sorted(out.glob("*/*.jsonl"))}


def test_trials_with_the_same_frames_prepare_them_once():
    own = {"senses": ("position",), "n_frames": 2, "noise": 0.5, "n_phantoms": 8}
    alike = [resolve("dqn", "pp-tracked", steps=64, **{name: value}) for name, value in own.items()]
    assert len({sweep._of_frames(config) for config in alike}) == 1
    probe = LinearArray(n_lines=32)
    assert sweep._of_frames(resolve("dqn", "pp-tracked", steps=64, probe=probe)).probe == probe


def test_what_is_finished_is_skipped_and_the_rest_is_run(quick, tmp_path):
    notes = Notes()
    assert run(plan("stay"), tmp_path, notes=notes)[0].reason is None
    n_finished, expected_ = notes.started_with
    assert n_finished == 0 and expected_.each == {plan("stay")[0].folder_name: 0.0}
    before = journals(tmp_path)
    outcomes = run(plan("stay", "random"), tmp_path, notes=notes)
    assert [outcome.reason for outcome in outcomes] == [None, None]
    n_finished, expected_ = notes.started_with
    assert n_finished == 1 and list(expected_.each) == [plan("random")[0].folder_name]
    assert journals(tmp_path).items() > before.items()
    assert not list(tmp_path.glob("*.earlier-*"))


def test_another_configuration_is_another_trial(quick, tmp_path):
    run(plan("stay"), tmp_path)
    notes = Notes()
    run([resolve("stay", "pp", noise=0.25)], tmp_path, notes=notes)
    n_finished, expected_ = notes.started_with
    assert n_finished == 0 and len(expected_.each) == 1


def test_failed_trial_is_named_and_the_others_go_on(quick, tmp_path, monkeypatch):
    def broken(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("usbench.agents.baselines.Stay._actions", broken)
    outcomes = run(plan("stay", "random"), tmp_path)
    assert [outcome.config.algo for outcome in outcomes] == ["stay", "random"]
    assert "No space left" in outcomes[0].reason and outcomes[1].reason is None


@pytest.mark.parametrize("seen", [True, False], ids=["seen", "taken after the look"])
def test_what_another_process_runs_comes_after_the_rest(quick, tmp_path, monkeypatch, seen):
    configs = plan("random", "stay")
    lock = lock_of(tmp_path / configs[0].folder_name)
    lock.acquire()
    looks = iter([seen])
    monkeypatch.setattr(sweep, "is_held", lambda place: next(looks, True) and is_held(place))

    class Releasing(Notes):
        def ended(self, outcome):
            super().ended(outcome)
            lock.release()

    notes = Releasing()
    run(configs, tmp_path, notes=notes)
    assert [outcome.config.algo for outcome in notes.ended_with] == ["stay", "random"]
    assert [outcome.reason for outcome in notes.ended_with] == [None, None]


def test_broken_record_fails_its_trial_only(quick, tmp_path):
    broken, whole = plan("random", "stay")
    (tmp_path / broken.folder_name).mkdir()
    (tmp_path / broken.folder_name / records.TRIAL).write_text("not JSON")
    outcomes = run([broken, whole], tmp_path)
    assert "is not a trial record" in outcomes[0].reason and outcomes[1].reason is None


def test_folder_that_cannot_be_written_is_refused(quick, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(records.ConfigurationError, match="choose another folder"):
        run(plan("stay"), tmp_path / "file" / "below")


def test_expected_time_comes_from_finished_trials_of_the_same_algorithm(quick, tmp_path):
    configs = plan("a2c", seeds=(0, 1, 2))
    notes = Notes()
    run(configs[:1], tmp_path, notes=notes)
    assert notes.started_with[1].published
    seconds = read_state(tmp_path / configs[0].folder_name)["timings"]["total_s"]
    told = expected.trials(configs[1:], tmp_path, 2)
    assert told.each == {config.folder_name: seconds for config in configs[1:]} and not told.published


def test_worker_that_dies_takes_only_its_trial_with_it(quick, tmp_path, monkeypatch, undisturbed):
    monkeypatch.setattr(sweep, "RETRIES", 1)
    # Workers that are forked from a process that has imported everything: spawned ones import for seconds.
    monkeypatch.setattr(multiprocessing, "get_context", lambda _: children.CONTEXT)
    notes = Notes()
    executor = functools.partial(sweep.processes, sweep_worker.dying)
    configs = [*plan("stay"), trials.config("vpg"), trials.config("dqn")]
    outcomes = run(configs, tmp_path, executor, jobs=2, notes=notes)
    assert {outcome.config.algo: outcome.reason for outcome in outcomes} == {
        "stay": "its process died 2 times (killed, or out of memory)",
        "vpg": None,
        "dqn": None,
    }
    assert notes.again == ["stay"]
    assert not multiprocessing.active_children()
    for config in configs[1:]:
        assert trials.bits(tmp_path / config.folder_name) == trials.bits(undisturbed(config.algo))


def test_a_closed_terminal_is_left_to_the_parent(monkeypatch):
    monkeypatch.setattr(multiprocessing, "get_context", lambda _: children.CONTEXT)
    with sweep.processes() as executor:
        for number in (signal.SIGINT, signal.SIGHUP):
            executor.submit(signal.raise_signal, number).result()
        assert executor.submit(sum, (1, 2)).result() == 3


def test_interrupted_sweep_keeps_the_state_of_its_trials(quick, tmp_path):
    config = resolve("vpg", "pp", steps=100_000)
    executor = functools.partial(sweep.processes, sweep_worker.quick)

    ended = threading.Event()

    def interrupt_when_it_runs():
        while not ended.wait(0.1):
            if list(tmp_path.glob("*/episodes.jsonl")):
                return os.kill(os.getpid(), signal.SIGINT)

    interrupting = threading.Thread(target=interrupt_when_it_runs)
    interrupting.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            run([config], tmp_path, executor)
    finally:
        ended.set()
        interrupting.join()
    assert read_state(tmp_path / config.folder_name)["status"] == "interrupted"
    assert not multiprocessing.active_children()


@pytest.mark.slow
def test_workers_do_not_outlive_a_sweep_that_was_killed(tmp_path):
    code = (
        "import functools, os, sweep_worker; from usbench.compare import sweep; import multiprocessing\n"
        "if __name__ == '__main__':\n"
        "    executor = sweep.processes(); print(executor.submit(os.getpid).result(), flush=True)\n"
        "    os.kill(os.getpid(), 9)\n"
    )
    script = tmp_path / "killed.py"
    script.write_text(code)
    env = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1] / "support")}
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, env=env, timeout=300)
    worker = int(done.stdout)
    for _ in range(100):
        if not Path(f"/proc/{worker}").exists():
            return
        time.sleep(0.1)
    os.kill(worker, signal.SIGKILL)
    pytest.fail("the worker lived on")


def test_a_process_that_is_started_ignores_ctrl_c_from_its_first_moment():
    """Else one that still imports would show its traceback when a whole group of processes is interrupted."""
    said = [sys.executable, "-c", "import signal; print(signal.getsignal(signal.SIGINT) is signal.SIG_IGN)"]
    before = signal.getsignal(signal.SIGINT)
    with sweep._interrupts_left_to_this_process():
        started = subprocess.run(said, capture_output=True, text=True, check=True)
    assert started.stdout == "True\n" and signal.getsignal(signal.SIGINT) is before
    with ThreadPoolExecutor(1) as other:  # where signals cannot be set
        other.submit(lambda: sweep._interrupts_left_to_this_process().__enter__()).result()
