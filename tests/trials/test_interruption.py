"""Ctrl-C during a training: put off to the next rollout, so that nothing is lost."""

import os
import signal
import threading

import pytest
import trials
from state_files import read_state

from usbench.trials import interruption, runner
from usbench.trials.callback import Silent


class Stopping(Silent):
    """Sends Ctrl-C to this process at a step, so many times."""

    def __init__(self, step, times=1):
        self.step, self.times, self.told = step, times, 0

    def training(self, now, *_):
        if now == self.step:
            for _ in range(self.times):
                os.kill(os.getpid(), signal.SIGINT)

    def stopping(self):
        self.told += 1


@pytest.fixture
def asked(quick, tmp_path):
    """`asked(step, times)`: a trial that Ctrl-C stops, and what it told."""

    def run(step, times=1):
        progress = Stopping(step, times)
        with pytest.raises(KeyboardInterrupt):
            runner.run_trial(trials.config("vpg"), tmp_path, progress=progress)
        return tmp_path / trials.config("vpg").folder_name, progress

    return run


def test_nothing_is_lost_between_two_resume_files(asked, undisturbed):
    folder, progress = asked(32)  # the end of a rollout; the resume file before is that of step 0
    assert progress.told == 1 and read_state(folder)["status"] == "interrupted"
    assert trials.go_on(folder) == 33
    assert trials.bits(folder) == trials.bits(undisturbed("vpg"))


def test_the_second_one_interrupts_at_once(asked, undisturbed):
    folder, progress = asked(32, times=2)
    assert progress.told == 1
    assert trials.go_on(folder) == trials.FIRST_TOLD
    assert trials.bits(folder) == trials.bits(undisturbed("vpg"))


def test_handlers_are_put_back():
    before = [signal.getsignal(number) for number in interruption.SIGNALS]
    with interruption.put_off(lambda: None) as asked:
        os.kill(os.getpid(), signal.SIGINT)
        assert asked.is_asked
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
    assert [signal.getsignal(number) for number in interruption.SIGNALS] == before


def test_what_is_ignored_stays_ignored(monkeypatch):
    before = signal.signal(signal.SIGTERM, signal.SIG_IGN)
    try:
        with interruption.put_off(lambda: None) as asked:
            os.kill(os.getpid(), signal.SIGTERM)
        assert not asked.is_asked
    finally:
        signal.signal(signal.SIGTERM, before)


def test_a_closed_terminal_is_put_off_too():
    before = signal.signal(signal.SIGHUP, signal.default_int_handler)
    try:
        with interruption.put_off(lambda: None) as asked:
            os.kill(os.getpid(), signal.SIGHUP)
            assert asked.is_asked
    finally:
        signal.signal(signal.SIGHUP, before)


def test_other_threads_hear_no_signals():
    found = []

    def work():
        with interruption.put_off(lambda: None) as asked:
            found.append(asked.is_asked)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert found == [False]
