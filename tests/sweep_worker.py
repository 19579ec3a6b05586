"""What a worker process of the tests begins with: drawn frames in place of simulated ones, and accidents."""

import os
import signal

import pytest


def quick():
    """Make trials of this process quick, as the fixture of that name does."""
    import conftest

    conftest.speed_up(pytest.MonkeyPatch())


def dying():
    """Quick, and every trial of `stay` kills its process."""
    quick()
    from usbench import runner

    run = runner.run_trial

    def run_or_die(config, out):
        if config.algo == "stay":
            os.kill(os.getpid(), signal.SIGKILL)
        return run(config, out)

    runner.run_trial = run_or_die
