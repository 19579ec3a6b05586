"""Trials on the workers of a Dask cluster, as a `concurrent.futures` executor for `sweep.run`.

A trial's records come back through the cluster, so that no disk is shared. Versions are compared before
anything runs: same seed, same bits holds for the same versions.
"""

import logging
import os
import platform
import socket
import tempfile
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from importlib.metadata import version
from pathlib import Path, PurePosixPath
from typing import Any
from urllib.parse import urlsplit

from filelock import Timeout

from usbench import records
from usbench.atomic import atomic_file
from usbench.checks import install
from usbench.records import ConfigurationError, TrialConfig
from usbench.records.lock import lock_of
from usbench.trials import configuration
from usbench.trials.callback import Silent
from usbench.trials.finished import find_finished

CONNECT_S = 5.0
MAX_GREETING = 1_000_000
CANCEL_CHECK_S = 1.0
PACKAGES = (*configuration.PACKAGES, "distributed")
# What comes back of a trial folder; TensorBoard's events lie one folder down. `trial.json` comes last:
# whoever finds it finds the rest.
FILES = (records.EPISODES, records.EVALUATIONS, records.MODEL, f"{records.TENSORBOARD}/*", records.TRIAL)
Files = Mapping[str, bytes]


class Cluster(Executor):
    """The workers of a Dask cluster; a context that lets go of them, and of what they have not finished.

    Attributes:
        n_workers: Workers when the connection was made; more may come, and go.
    """

    def __init__(self, address: str) -> None:
        """Connect to the scheduler at `address`, for example tcp://host:8786.

        Raises:
            ConfigurationError: If Dask is not installed, no scheduler answers, or the workers do not fit.
        """
        self._address = address
        self._client = _connect(address)
        try:
            self.n_workers = _check_workers(self._client, address)
        except BaseException:
            self._client.close()
            raise
        # Each call is another trial, even where arguments are equal; a worker that dies costs no retry.
        self._remote = self._client.get_executor(pure=False, retries=2)
        # Writing would hold up the thread that talks to the cluster.
        self._writer = ThreadPoolExecutor(1)

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Have a worker call `fn(config, folder, progress=...)`, as `sweep.work`; bring the records to `out`.

        `args` are the trial's configuration and the folder `out`. The result is the function's.
        """
        config, out = args
        records.check_writable(out)
        ended: Future[Any] = Future()
        remote = self._remote.submit(on_worker, fn, config, configuration.versions(PACKAGES))
        remote.add_done_callback(lambda done: self._writer.submit(self._settle, ended, done, config, out))
        return ended

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Let go of the cluster; trials that are still running there stop, those that came back are kept."""
        self._client.close()
        self._writer.shutdown()

    def _settle(self, ended: Future[Any], remote: Future[Any], config: TrialConfig, out: Path) -> None:
        from distributed import KilledWorker

        try:
            if remote.cancelled():
                raise RuntimeError(
                    f"the cluster at {self._address} is lost; what was finished is kept, and the same "
                    "command goes on."
                )
            reason, files = remote.result()
            _bring(files, config, out)
        except KilledWorker as error:
            died = error.allowed_failures + 1
            ended.set_result(f"{died} workers died with it (killed, or out of memory)")
        except Timeout:
            ended.set_result("another process runs it here")
        except Exception as error:
            ended.set_exception(error)
        else:
            ended.set_result(reason)


def on_worker(
    function: Callable[..., str | None],
    config: TrialConfig,
    expected: Mapping[str, str],
) -> tuple[str | None, Files]:
    """Run one trial on a worker, in a folder that goes with it; return why it failed, and its files."""
    from distributed import get_worker

    worker = get_worker()
    # Again, for workers that have come since.
    _check_worker(worker.address, configuration.versions(PACKAGES), worker.state.nthreads, expected)
    os.environ["USBENCH_THREADS"] = "1"
    # The worker's own folder: Dask clears it away after a worker that was killed.
    with tempfile.TemporaryDirectory(dir=worker.local_directory, prefix="usbench-") as folder:
        try:
            reason = function(config, Path(folder), progress=_UntilCancelled(worker))
        except KeyboardInterrupt:  # nobody waits for it any more; Dask would end the worker
            return "stopped", {}
        return reason, _files(Path(folder) / config.folder_name)


class _UntilCancelled(Silent):
    """Progress of a trial on a worker, which breaks off when the trial is not wanted any more.

    Dask cannot end a task that is running: an interrupted comparison would occupy its workers for hours.
    """

    def __init__(self, worker: Any) -> None:
        self._tasks, self._key = worker.state.tasks, worker.get_current_task()
        self._next = 0.0

    def training(self, *_: Any) -> None:
        self.frames()

    def frames(self, *_: Any) -> None:
        if time.monotonic() < self._next:
            return
        self._next = time.monotonic() + CANCEL_CHECK_S
        task = self._tasks.get(self._key)
        if task is None or task.state == "cancelled":
            raise KeyboardInterrupt


def _connect(address: str) -> Any:
    try:
        import distributed
    except ImportError as error:
        raise ConfigurationError(
            f"trials on a cluster need Dask, which is not installed: {install('dask')}."
        ) from error
    # Before Dask sees it: a client that cannot read its address is never quite closed.
    if not _is_address(address):
        raise ConfigurationError(
            f"cluster must be the address of a Dask scheduler, for example tcp://host:8786, not {address!r}."
        )
    # What it has to say comes as tracebacks, beside the one sentence that tells of it.
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
    try:
        _hear(address)
        client: Any = distributed.Client  # without types
        return client(address, timeout=CONNECT_S, set_as_default=False)
    except Exception as error:  # refused, not resolved, timed out, or something else answers there
        raise ConfigurationError(
            f"no Dask scheduler answers at {address} within {CONNECT_S:g} s: start one, or give the address "
            "of another."
        ) from error


def _hear(address: str) -> None:
    """Raise OSError unless something like Dask speaks at `address`; Dask itself waits for ever for it to."""
    parts = urlsplit(address)
    with socket.create_connection((parts.hostname, parts.port), timeout=CONNECT_S) as connection:
        # Whoever listens for Dask begins, with the length of its greeting; with TLS it is the other's turn.
        greeting = b""
        while parts.scheme == "tcp" and len(greeting) < 8:
            part = connection.recv(8 - len(greeting))
            if not part:
                raise ConnectionError("hung up")
            greeting += part
        if int.from_bytes(greeting, "little") > MAX_GREETING:
            raise ConnectionError("speaks something else")


def _is_address(text: str) -> bool:
    try:
        parts = urlsplit(text)
        return bool(
            text.isprintable() and parts.scheme in ("tcp", "tls") and parts.hostname and parts.port
        ) and (f"{parts.scheme}://{parts.netloc}" == text)
    except ValueError:  # a port that is none
        return False


def _check_workers(client: Any, address: str) -> int:
    """Return how many workers there are; ConfigurationError if there are none, or one does not fit."""
    threads = client.nthreads()
    if not threads:
        raise ConfigurationError(f"the cluster at {address} has no workers yet: start some and try again.")
    # Functions of the standard library alone: a worker of another version must be able to answer.
    found = {"python": client.run(platform.python_version)}
    found |= {name: client.run(version, name, on_error="return") for name in PACKAGES}
    for worker, n_threads in threads.items():
        own = {name: str(answers.get(worker, "none")) for name, answers in found.items()}
        _check_worker(worker, own, n_threads, configuration.versions(PACKAGES))
    return len(threads)


def _check_worker(
    address: str, found: Mapping[str, str], n_threads: int, expected: Mapping[str, str]
) -> None:
    if n_threads != 1:
        raise ConfigurationError(
            f"the worker {address} has {n_threads} threads: start workers with --nthreads 1, since each runs "
            "one trial in one thread."
        )
    for name, wanted in expected.items():
        if found[name] != wanted:
            raise ConfigurationError(
                f"the worker {address} has {name} {found[name]}, this machine {wanted}: all machines of a "
                "comparison need the same versions."
            )


def _files(folder: Path) -> dict[str, bytes]:
    """Return the contents of the files that a trial leaves, by their names in its folder."""
    paths = [path for pattern in FILES for path in sorted(folder.glob(pattern))]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}


def _bring(files: Files, config: TrialConfig, out: Path) -> None:
    """Write the files of a trial into its folder in `out`, `trial.json` last.

    Raises:
        Timeout: If another process has the trial's lock: results of others are not held back for it.
    """
    strange = [name for name in files if not any(PurePosixPath("/", name).match(f"/{own}") for own in FILES)]
    if strange:
        raise ValueError(f"a worker sent a file {strange[0]!r} that does not belong to a trial.")
    if not files:
        return
    with lock_of(out / config.folder_name):
        if find_finished(config, out) is not None:  # by another sweep, meanwhile
            return
        folder = records.create(out, config)
        for name, content in files.items():
            (folder / name).parent.mkdir(exist_ok=True)
            with atomic_file(folder / name) as file:
                file.write(content)
