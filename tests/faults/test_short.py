"""The short version of this folder, for every run of the tests: SIGKILL in the midst of learning."""

import os
import random
import signal
import time

import children
import trials
from state_files import read_state

from usbench import records


def test_trial_killed_twice(undisturbed, quick, tmp_path):
    config, chance = trials.config("vpg"), random.Random(0)
    journal = tmp_path / config.folder_name / records.EPISODES
    for n_episodes in (1, 3):
        process = children.start(children.trial, config, tmp_path)
        while process.is_alive() and (not journal.exists() or journal.read_bytes().count(b"\n") < n_episodes):
            time.sleep(0.001)
        time.sleep(chance.uniform(0, 0.05))
        os.kill(process.pid, signal.SIGKILL)
        process.join()
        assert process.exitcode == -signal.SIGKILL
    assert read_state(journal.parent)["status"] == "running"
    assert children.finish(children.trial, config, tmp_path) == 0
    assert trials.bits(journal.parent) == trials.bits(undisturbed("vpg"))
    assert {path.name for path in tmp_path.iterdir()} == {config.folder_name, ".locks"}
    assert not list(tmp_path.rglob("*.part")) and not children.session(process.pid)
