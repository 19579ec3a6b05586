"""Ctrl-C, SIGTERM and SIGHUP put off to the next moment at which a training can be kept without a loss."""

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass

# Windows has no SIGHUP, which comes where a terminal is closed.
SIGNALS = (signal.SIGINT, signal.SIGTERM, *([signal.SIGHUP] if hasattr(signal, "SIGHUP") else []))


@dataclass
class Interruption:
    """Whether somebody has asked for the end of what is running."""

    is_asked: bool = False


@contextlib.contextmanager
def put_off(tell: Callable[[], None]) -> Iterator[Interruption]:
    """Let the first signal only be noted, after which `tell` is called; a second one interrupts at once.

    A signal that is ignored, or does what it does by default, stays so: the command line gives SIGTERM a
    handler before. Outside the main thread, where no signal arrives, nothing changes.
    """
    interruption = Interruption()
    if threading.current_thread() is not threading.main_thread():
        yield interruption
        return

    def note(*_: object) -> None:
        if interruption.is_asked:
            raise KeyboardInterrupt
        interruption.is_asked = True
        tell()

    before = {number: signal.getsignal(number) for number in SIGNALS}
    heard = {number: handler for number, handler in before.items() if callable(handler)}
    for number in heard:
        signal.signal(number, note)
    try:
        yield interruption
    finally:
        for number, handler in heard.items():
            signal.signal(number, handler)
