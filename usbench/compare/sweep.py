"""Many trials on `concurrent.futures` executors: processes here, or the workers of a cluster.

Each of `jobs` slots runs one trial at a time on an executor of its own. A worker that dies (killed, or out of
memory) takes one trial with it and no other; that trial starts again on a fresh one, at most twice.
"""

import contextlib
import multiprocessing
import os
import signal
import threading
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from queue import SimpleQueue
from typing import Any, NoReturn, Protocol

from filelock import Timeout

from usbench.agents.zoo import entry
from usbench.compare import expected
from usbench.compare.expected import Expected
from usbench.records import ConfigurationError, TrialConfig, check_writable
from usbench.records.lock import is_held
from usbench.setting import Setting
from usbench.trials import runner
from usbench.trials.finished import find_finished
from usbench.trials.resume_files import ResumeFiles
from usbench.words import in_one_line

RETRIES = 2


@dataclass(frozen=True)
class Outcome:
    """How a trial ended: `reason` is None if it is finished, else why it is not.

    A `note` says for what it was trained, where the configuration does not.
    """

    config: TrialConfig
    reason: str | None
    note: str = ""

    @property
    def title(self) -> str:
        """The trial in words."""
        return f"{self.config.title}, {self.note}" if self.note else self.config.title


class Progress(Protocol):
    """What a sweep tells while it runs."""

    def frames(self, done: int, total: int) -> None:
        """`done` of `total` frames are simulated."""

    def started(self, n_finished: int, expected: Expected) -> None:
        """The trials of `expected` will run; `n_finished` are finished."""

    def ended(self, outcome: Outcome) -> None:
        """A trial has ended, or was found damaged."""

    def retried(self, config: TrialConfig) -> None:
        """The process of a trial died; the trial starts again."""


def processes(initializer: Callable[[], None] | None = None) -> Executor:
    """Return an executor for one trial at a time in a separate process, which `initializer` prepares."""
    # Spawned, not forked: a fork would inherit torch's threads and the parent's random states.
    return ProcessPoolExecutor(
        1, multiprocessing.get_context("spawn"), initializer=_begin, initargs=(initializer,)
    )


def run(
    configs: Sequence[TrialConfig],
    out: Path,
    progress: Progress,
    *,
    jobs: int = 1,
    executor: Callable[[], Executor] = processes,
    submitted: int | None = None,
    evaluates_on_the_way: bool = True,
) -> list[Outcome]:
    """Run the trials that are not finished in the folder `out`, in this order, `jobs` at a time.

    A trial that fails does not stop the others. Records are the same for any number of jobs.

    Args:
        configs: The trials.
        out: Folder for their records.
        progress: Who is told.
        jobs: Trials that run at a time.
        executor: Makes what a trial runs on.
        submitted: Trials that are handed over at a time, where `executor` keeps a queue of its own.
        evaluates_on_the_way: Whether trials have a learning curve, or only the evaluation at their end.

    Returns:
        How each trial ended, those that were finished before, or damaged since, first.

    Raises:
        ConfigurationError: If `out` cannot be written.
        KeyboardInterrupt: After the running trials have kept their state.
    """
    known = {config.folder_name: _known(config, out) for config in configs}
    outcomes = [outcome for outcome in known.values() if outcome is not None]
    for outcome in outcomes:
        if outcome.reason is None:  # what a process left that was killed in its last moment
            ResumeFiles(out / outcome.config.folder_name, 0.0).clear()
    damaged = [outcome for outcome in outcomes if outcome.reason is not None]
    missing = [config for config in configs if known[config.folder_name] is None]
    if missing:
        check_writable(out)
    looking = [config for config in missing if entry(config.algo).looks]
    # Once, before the workers start: they would all simulate the same frames.
    for setting in dict.fromkeys(_of_frames(config) for config in looking):
        setting.prepare_frames(progress.frames)
    progress.started(len(outcomes) - len(damaged), expected.trials(missing, out, jobs))
    for outcome in damaged:
        progress.ended(outcome)
    others = set(multiprocessing.active_children())
    slots = [executor() for _ in range(min(submitted or jobs, len(missing)))]
    try:
        working = partial(work, evaluates_on_the_way=evaluates_on_the_way)
        for outcome in _outcomes(missing, working, out, slots, executor, progress):
            progress.ended(outcome)
            outcomes.append(outcome)
    except BaseException:
        for process in set(multiprocessing.active_children()) - others:
            process.terminate()
        raise
    finally:
        for slot in slots:
            slot.shutdown(cancel_futures=True)
    return outcomes


def _of_frames(config: TrialConfig) -> Setting:
    """Return the setting of a trial with what its frames do not depend on at its default."""
    return replace(Setting.recorded(config).scored, noise=0.0, n_frames=1, senses=(), n_phantoms=None)


def _outcomes(
    configs: Sequence[TrialConfig],
    working: Callable[..., str | None],
    out: Path,
    slots: list[Executor],
    executor: Callable[[], Executor],
    progress: Progress,
) -> Iterator[Outcome]:
    """Yield how each trial ended, as they end; an executor whose worker died is replaced in `slots`."""
    queue, free = deque(configs), deque(range(len(slots)))
    running: dict[Future[str | None], tuple[TrialConfig, int]] = {}
    ended: SimpleQueue[Future[str | None]] = SimpleQueue()
    deaths: Counter[str] = Counter()
    while queue or running:
        while queue and free:
            (config, is_others), slot = _next(queue, out), free.popleft()
            submitted = partial(working, waits=is_others)
            with _interrupts_left_to_this_process():
                try:
                    future = slots[slot].submit(submitted, config, out)
                except BrokenExecutor:  # it died between two trials
                    slots[slot].shutdown()
                    slots[slot] = executor()
                    future = slots[slot].submit(submitted, config, out)
            running[future] = config, slot
            future.add_done_callback(ended.put)
        future = ended.get()
        config, slot = running.pop(future)
        free.append(slot)
        try:
            reason = future.result()
        except BrokenExecutor:
            slots[slot].shutdown()
            slots[slot] = executor()
            deaths[config.folder_name] += 1
            if deaths[config.folder_name] <= RETRIES:
                progress.retried(config)
                queue.append(config)
                continue
            reason = f"its process died {RETRIES + 1} times (killed, or out of memory)"
        except Timeout:  # another process took it in the meantime
            queue.append(config)
            continue
        yield Outcome(config, reason)


@contextlib.contextmanager
def _interrupts_left_to_this_process() -> Iterator[None]:
    """Let a process that is started meanwhile ignore Ctrl-C from its first moment, long before `_begin`."""
    before = signal.getsignal(signal.SIGINT)
    # Other threads may not set it, and a handler that is not Python's could not be put back.
    if before is None or threading.current_thread() is not threading.main_thread():
        yield
        return
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _next(queue: deque[TrialConfig], out: Path) -> tuple[TrialConfig, bool]:
    """Take the first trial that no other process runs, or the first of all where others run each of them.

    Return it, and whether another process runs it.
    """
    place = next((k for k, config in enumerate(queue) if not is_held(out / config.folder_name)), None)
    config = queue[place or 0]
    del queue[place or 0]
    return config, place is None


def work(config: TrialConfig, out: Path, **options: Any) -> str | None:
    """Run one trial on a worker, with `run_trial`'s options; return why it failed, None if it is finished."""
    try:
        with _stoppable():
            runner.run_trial(config, out, **options)
    except (ConfigurationError, Timeout):
        raise
    except Exception as error:
        return in_one_line(error)
    return None


def _begin(initializer: Callable[[], None] | None) -> None:
    """Prepare a worker process: one thread, no life after its parent's death, signals left to the parent."""
    os.environ["USBENCH_THREADS"] = "1"
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(signal, "SIGHUP"):  # not on Windows
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
    threading.Thread(target=_follow_parent, daemon=True).start()
    if initializer is not None:
        initializer()


def _follow_parent() -> NoReturn:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


@contextlib.contextmanager
def _stoppable() -> Iterator[None]:
    """Let SIGTERM end the trial of a worker process with its state kept, and the process after it."""
    if multiprocessing.parent_process() is None or threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(*_: Any) -> NoReturn:
        # A second one must not disturb the writing.
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        raise KeyboardInterrupt

    signal.signal(signal.SIGTERM, stop)
    try:
        yield
    except KeyboardInterrupt:
        # Not raised: the executor would catch it, and the process would wait for more work.
        os._exit(130)
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _known(config: TrialConfig, out: Path) -> Outcome | None:
    """Return how a trial ended before: finished, or damaged since then; None if it is to be run."""
    try:
        return None if find_finished(config, out) is None else Outcome(config, None)
    except ValueError as error:
        return Outcome(config, str(error))
