"""What a person sees of many trials: a bar with the time left, and a line for each that ends."""

import sys
import time
from collections.abc import Mapping, Sequence

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from usbench.compare.expected import End, Expected
from usbench.compare.sweep import Outcome
from usbench.records import TrialConfig
from usbench.waiting import duration


class SweepBars:
    """Progress on stderr: a bar in a terminal, whole lines in a file or a pipe.

    A `usbench.compare.sweep.Progress` and a context; `quiet` leaves only what went wrong.
    """

    def __init__(self, quiet: bool = False) -> None:
        """Draw nothing yet."""
        self._console = Console(stderr=True, highlight=False, soft_wrap=True)
        self._quiet, self._quarter = quiet, 0
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TextColumn("{task.fields[left]}"),
            console=self._console,
            disable=quiet or not sys.stderr.isatty(),
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

    def rung(self, number: int, n_rungs: int, scores: Mapping[int, float | None]) -> None:
        """A search begins a rung with these candidates; each has its score in the rung before, if any."""
        told = [f"{name}" if score is None else f"{name} ({score:.3f})" for name, score in scores.items()]
        words = "candidate" if len(told) == 1 else "candidates"
        self._say(f"rung {number} of {n_rungs}: {words} {', '.join(told)}")

    def started(self, n_finished: int, expected: Expected) -> None:
        """The trials of `expected` will run, and `n_finished` are finished."""
        self._expected, self._ends, self._begun = expected, list[End](), time.monotonic()
        n_missing = len(expected.each)
        self._task = self._bar.add_task("trials", total=n_missing, left="")
        told = f"{n_missing} {'trial' if n_missing == 1 else 'trials'} to run, {n_finished} finished already"
        if n_missing:
            told += f", {duration(expected.seconds)}" if expected.told else ", no record tells how long"
            told += " as in the published trials" if expected.published else ""
        self._say(told)

    def ended(self, outcome: Outcome) -> None:
        """A trial has ended, or was found damaged."""
        if outcome.config.folder_name not in self._expected.each:
            self._say(f"{outcome.title}: damaged")
            return
        finished = outcome.reason is None
        self._ends.append(End(outcome.config.folder_name, time.monotonic() - self._begun, finished))
        n_ended, n_missing = len(self._ends), len(self._expected.each)
        seconds = self._expected.left(self._ends)
        goes_on = n_ended < n_missing or self._expected.later
        left = f"{duration(seconds)} left" if goes_on and seconds is not None else ""
        self._bar.update(self._task, completed=n_ended, left=left)
        told = f"[{n_ended}/{n_missing}] {outcome.title}: {'finished' if finished else 'failed'}"
        self._say(f"{told}, {left}" if left else told)

    def retried(self, config: TrialConfig) -> None:
        """The process of a trial died; the trial starts again."""
        self._say(f"{config.title}: its process died, the trial starts again")

    def _say(self, line: str) -> None:
        if not self._quiet:
            self._console.print(line, markup=False)


def failures(outcomes: Sequence[Outcome]) -> list[str]:
    """Return a line with its reason for each trial that failed."""
    failed = [outcome for outcome in outcomes if outcome.reason is not None]
    return [f"{outcome.title} failed: {outcome.reason}" for outcome in failed]
