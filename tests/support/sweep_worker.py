"""How worker processes of the tests start: with drawn frames in place of simulated ones, or to die."""

import os
import signal
import time

import pytest
from quick_trials import speed_up


def quick():
    """Make trials of this process quick."""
    speed_up(pytest.MonkeyPatch())


def dying():
    """Make trials of this process quick, with many resume files; every trial of `stay` kills its process."""
    quick()
    from usbench.trials import resume_files, runner

    # A forked process has not the environment of the test.
    os.environ[resume_files.INTERVAL] = "0"
    run = runner.run_trial

    def run_or_die(config, out, **more):
        if config.algo == "stay":
            os.kill(os.getpid(), signal.SIGKILL)
        return run(config, out, **more)

    runner.run_trial = run_or_die


def dask_setup(worker):
    """Prepare a worker of a Dask cluster, also one that is started in place of another."""
    quick()


def busy(dask_worker):
    """How many trials run on a worker of a Dask cluster now."""
    return len(dask_worker.active_threads)


def dawdle_once(mark, config, out, progress, **_):
    """Run a trial; the first trial of vpg waits.

    It waits until its process is killed, until the trial is given up, or until `mark`.end exists.
    """
    from usbench.compare import sweep

    if config.algo != "vpg" or mark.exists():
        return sweep.work(config, out)
    mark.write_text(str(os.getpid()))
    for _ in range(3000):
        time.sleep(0.1)
        progress.frames(0, 1)
        if mark.with_suffix(".end").exists():
            break
    raise TimeoutError


def die(*_, **__):
    """Kill the worker that begins with a trial, whichever it is."""
    os.kill(os.getpid(), signal.SIGKILL)
