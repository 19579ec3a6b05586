"""The desk: does what the page's buttons ask for, one piece of work after the other, beside the server.

Some of the work takes seconds: to load PyTorch, to plan a large task, to simulate the first frame of a depth.
The server never waits for such work: it shows the last state and says what is being done.
"""

from __future__ import annotations

import contextlib
import queue
import threading
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from usbench.guide.session import Session

Tell = Callable[[str], None]
Work = Callable[["Session"], None]
# s after an answer in which nothing is got ready: sending and drawing the answer needs the same cores.
# benchmarks/guide.py best:pp-tracked: 9 of 10 keys are shown within 31 ms, without it 40; with --pause 0,
# the median is 30 ms, without it 35.
ANSWERING = 0.015
# What a page that is out of date says, once it is no longer.
ELSEWHERE = "This examination went on in another tab: the page shows now where it is."


class Desk:
    """One session and the thread that works on it; nothing else touches the session.

    Attributes:
        failure: Why there is no session; None if there is one, or will be.
    """

    def __init__(self) -> None:
        """Nothing is done before `start`."""
        self.failure: Exception | None = None
        self._doing, self._n_asked = "starting", 1  # to make the session is asked for already
        self._shown: Mapping[str, Any] = {}
        self._jobs: queue.SimpleQueue[tuple[Work, Future[None]] | None] = queue.SimpleQueue()

    def start(self, make: Callable[[Tell], Session], failed: Callable[[], None] = lambda: None) -> None:
        """Begin to make the session, and to work on it.

        Args:
            make: Makes the session; it is passed what tells in words what is being done.
            failed: Called if `make` raises an error, which is `failure` then.
        """
        # The end of the program does not wait for this thread.
        threading.Thread(target=self._run, args=(make, failed), name="desk", daemon=True).start()

    @property
    def busy(self) -> str:
        """What is being done of what was asked for, in words; empty if all is done."""
        return self._doing if self._n_asked else ""

    def state(self) -> dict[str, Any]:
        """Return what the page shows: the session after its last work, and what is being done now."""
        busy = self.busy  # read first: what is shown may only be newer than it says
        return {**self._shown, "busy": busy}

    def do(self, work: Work) -> Future[None]:
        """Let `work` be done on the session, after what was asked for before; the result holds its error."""
        job: Future[None] = Future()
        self._n_asked += 1
        self._jobs.put((work, job))
        return job

    def close(self) -> None:
        """Let the thread end after its present work, without waiting for it."""
        self._jobs.put(None)

    def _run(self, make: Callable[[Tell], Session], failed: Callable[[], None]) -> None:
        try:
            session = make(self._tell)
            self._show(session)
        except Exception as error:
            self.failure = error
            failed()
            return
        self._n_asked -= 1
        while (asked := self._next(session)) is not None:
            work, job = asked
            refusal = self._error(work, session)
            self._n_asked -= 1
            if refusal is None:
                job.set_result(None)
            else:
                job.set_exception(refusal)

    def _tell(self, doing: str) -> None:
        self._doing = doing

    def _next(self, session: Session) -> tuple[Work, Future[None]] | None:
        """Return what is asked for next; once the answer is out, get ready what may be asked."""
        with contextlib.suppress(queue.Empty):
            return self._jobs.get(timeout=ANSWERING)
        # What cannot be got ready raises its error when it is asked for.
        with contextlib.suppress(Exception):
            while self._jobs.empty() and session.prepare():
                pass
        return self._jobs.get()

    def _error(self, work: Work, session: Session) -> Exception | None:
        """Do `work` and show the session; return their error, None if there was none."""
        error = _raised(lambda: work(session))
        return _raised(lambda: self._show(session, error)) or error

    def _show(self, session: Session, error: Exception | None = None) -> None:
        """Show the session; why its last work failed takes the place of its message."""
        told = {} if error is None else {"message": str(error)}
        self._shown = session.state() | told | {"elsewhere": ELSEWHERE}


def _raised(call: Callable[[], None]) -> Exception | None:
    """Return the error of a call, None if there was none."""
    try:
        call()
    except Exception as error:
        return error
    return None
