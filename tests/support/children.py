"""The processes that tests kill: they start within milliseconds, and their trials are quick."""

import contextlib
import functools
import multiprocessing
import os
import signal
import sys
from pathlib import Path

import sweep_worker

from usbench import cli, records
from usbench.compare import sweep
from usbench.trials import resume_files, runner

# Forked from a process that has imported everything: a spawned process would spend its time on imports.
CONTEXT = multiprocessing.get_context("forkserver")
CONTEXT.set_forkserver_preload(
    # The first optimizer imports torch._dynamo, which takes longer than these trials.
    ["pytest", "usbench.cli", "usbench.compare.sweep", "usbench.agents.vpg", "sb3_contrib"]
    + ["torch.utils.tensorboard", "torch._dynamo"]
)

# For processes that never end; long, since a machine with other work is slow.
LIMIT_S = 1800


def start(what, *arguments, seconds=0.0):
    process = CONTEXT.Process(target=_begin, args=(seconds, what, *arguments))
    process.start()
    return process


def finish(what, *arguments, **settings):
    """Run a process to its end; return its exit status."""
    return ended(start(what, *arguments, **settings))


def ended(process):
    """Wait for the end of a process; return its exit status."""
    process.join(LIMIT_S)
    if process.exitcode is None:
        os.killpg(process.pid, signal.SIGKILL)
        process.join()
    return process.exitcode


def _begin(seconds, what, *arguments):
    # A new session, so that all processes of it can be killed at once.
    os.setsid()
    # A shell starts background processes with Ctrl-C ignored, and their children inherit that.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    os.environ[resume_files.INTERVAL] = str(seconds)
    os.environ["USBENCH_THREADS"] = "1"
    sweep_worker.quick()
    what(*arguments)


def trial(config, out):
    runner.run_trial(config, out)


def told(config, out, path):
    """Run a trial and write to `path` how it ended."""
    try:
        runner.run_trial(config, out)
    except Exception as error:
        path.write_text(f"{type(error).__name__}: {error}")
    else:
        path.write_text("finished")


def command(*argv):
    sys.exit(cli.main(argv))


class Silent:
    def __getattr__(self, _):
        return lambda *_: None


def many(configs, out, jobs):
    executor = functools.partial(sweep.processes, sweep_worker.quick)
    outcomes = sweep.run(configs, out, Silent(), jobs=jobs, executor=executor)
    assert all(outcome.reason is None for outcome in outcomes), outcomes


def measured(configs, out, path):
    """Run trials one after another; write the memory held (MB) after every episode and every trial."""
    sizes = []

    class Measure(Silent):
        def training(self, *_):
            sizes.append(_resident_mb())

    for config in configs:
        runner.run_trial(config, out, progress=Measure())
        if len(configs) > 1:
            sizes.append(_resident_mb())
    path.write_text(" ".join(map(str, sizes)))


def _resident_mb():
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def workers(pid):
    """The processes that a process has started."""
    return _processes(1, pid)


def session(pid):
    """All processes that are left of what `start` began, zombies too: workers and their helpers."""
    return _processes(3, pid)


def _processes(place, number):
    found = []
    for status in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            # After the name, which stands in brackets and may hold anything: state, parent, group, session.
            if int(status.read_text().rpartition(")")[2].split()[place]) == number:
                found.append(int(status.parent.name))
    return found


def is_begun(folder):
    path = folder / records.EPISODES
    return path.exists() and path.stat().st_size > 0
