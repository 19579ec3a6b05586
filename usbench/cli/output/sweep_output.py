"""What a person sees of many trials: a bar with the time left, and a line for each that ends."""

import sys
import time
from collections.abc import Sequence

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from usbench.compare.expected import Expected
from usbench.compare.sweep import Outcome
from usbench.records import TrialConfig


class SweepBars:
    """Progress on stderr: a bar in a terminal, whole lines in a file or a pipe.

    A `usbench.compare.sweep.Progress` and a context; `quiet` leaves only what went wrong.
    """

    def __init__(self, quiet: bool = False) -> None:
        """Draw nothing yet."""
        self._console = Console(stderr=True, highlight=False, soft_wrap=True)
        self._quiet, self._quarter, self._ended, self._missing = quiet, 0, 0, 0
        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TextColumn("left:"),
            # The speed over the whole sweep: trials end in bursts, hours apart.
            TimeRemainingColumn(),
        )
        self._bar = Progress(
            *columns,
            console=self._console,
            disable=quiet or not sys.stderr.isatty(),
            speed_estimate_period=86_400,
        )

    def __enter__(self) -> "SweepBars":
        """Begin to draw."""
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Leave the bar as it stands."""
        self._bar.stop()

    def frames(self, done: int, total: int) -> None:
        """`done` of `total` frames are simulated."""
        if total and 4 * done // total != self._quarter:
            self._quarter = 4 * done // total
            self._say(f"simulating frames: {done} of {total}")

    def started(self, n_missing: int, n_finished: int, expected: Expected | None) -> None:
        """`n_missing` trials will run and `n_finished` are finished."""
        self._missing, self._ended, self._begun = n_missing, 0, time.monotonic()
        self._task = self._bar.add_task("trials", total=n_missing)
        told = f"{n_missing} {'trial' if n_missing == 1 else 'trials'} to run, {n_finished} finished already"
        if n_missing:
            told += (
                ", no record tells how long" if expected is None else f", about {_duration(expected.seconds)}"
            )
            told += " as in the published trials" if expected is not None and expected.published else ""
        self._say(told)

    def ended(self, outcome: Outcome) -> None:
        """A trial has ended."""
        self._ended += 1
        self._bar.advance(self._task)
        state = "finished" if outcome.reason is None else "failed"
        left = self._missing - self._ended
        told = f", about {_duration(left * self._seconds_each())} left" if left else ""
        self._say(f"[{self._ended}/{self._missing}] {outcome.config.title}: {state}{told}")

    def retried(self, config: TrialConfig) -> None:
        """The process of a trial died; the trial starts again."""
        self._say(f"{config.title}: its process died, the trial starts again")

    def _seconds_each(self) -> float:
        """Return what a trial has taken so far, trials side by side counted once."""
        return (time.monotonic() - self._begun) / self._ended

    def _say(self, line: str) -> None:
        if not self._quiet:
            self._console.print(line, markup=False)


def failures(outcomes: Sequence[Outcome]) -> list[str]:
    """Return a line with its reason for each trial that failed."""
    failed = [outcome for outcome in outcomes if outcome.reason is not None]
    return [f"{outcome.config.title} failed: {outcome.reason}" for outcome in failed]


def _duration(seconds: float) -> str:
    minutes = round(seconds / 60)
    return f"{minutes // 60} h {minutes % 60} min" if minutes >= 60 else f"{max(minutes, 1)} min"
