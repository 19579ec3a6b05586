"""What a person sees of one trial while it runs."""

import contextlib
import sys
import time
from typing import IO, Any, cast

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from usbench.waiting import duration


class Bars:
    """Progress on stderr: bars in a terminal, a line now and then in a file or a pipe.

    A `usbench.trials.callback.Progress`. That it cannot be written ends no training; the signal of a terminal
    that is closed ends it as Ctrl-C does, unless it is ignored (nohup).
    """

    def __init__(self) -> None:
        """Draw nothing yet."""
        stream = cast(IO[str], _PerhapsUnread(sys.stderr))
        self._console = Console(file=stream, highlight=False, soft_wrap=True)
        self._bars = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TextColumn("left:"),
            TimeRemainingColumn(),
            TextColumn("{task.fields[told]}"),
            console=self._console,
            disable=not sys.stderr.isatty(),
            refresh_per_second=4,
            # As training goes on it takes longer per step, and evaluations come between.
            speed_estimate_period=600,
        )
        self._tasks: dict[str, TaskID] = {}
        self._quarter = 0
        # When the training began, at which step, and at which of how many steps it is.
        self._begun: tuple[float, int] | None = None
        self._now = (0, 0)

    def frames(self, done: int, total: int) -> None:
        """`done` of `total` frames are simulated."""
        self._show("simulating frames", done, total)
        if self._bars.disable and total and 4 * done // total > self._quarter:
            self._quarter = 4 * done // total
            self._say(f"simulating frames: {done} of {total}")

    def expected(self, wall_s: float, cpu_s: float) -> None:
        """Training and evaluations begin now, and take about `wall_s` and `cpu_s` of CPU time."""
        told = (
            f"training and evaluations: {duration(wall_s)} ({duration(cpu_s)} of CPU time), estimated from a "
        )
        self._say(f"{told}short test on this machine")

    def training(self, step: int, steps: int, mean_return: float, score: float) -> None:
        """Training is at `step` of `steps`; mean return and normalised score of the last episodes."""
        if self._begun is None:
            self._begun = time.monotonic(), step
        self._now = step, steps
        self._show("training", step, steps, f"return {mean_return:.2f}, score {score:.2f}")

    def evaluated(self, step: int, mean_return: float, score: float) -> None:
        """The agent was evaluated at `step`; mean return and score of its greedy actions."""
        self._say(
            f"step {step}: evaluation return {mean_return:.2f}, normalised score {score:.2f}{self._to_go()}"
        )

    def stopping(self) -> None:
        """Somebody has asked for the end, which comes before the next rollout."""
        self._say("stopping before the next rollout; Ctrl-C again stops at once")

    def close(self) -> None:
        """Leave the last bar as it stands."""
        self._bars.stop()

    def _to_go(self) -> str:
        """Return in words how long the training goes on, as it went so far; empty where nobody knows."""
        step, steps = self._now
        if self._begun is None or step <= self._begun[1] or step >= steps:
            return ""
        each = (time.monotonic() - self._begun[0]) / (step - self._begun[1])
        return f", {duration(each * (steps - step))} to go"

    def _show(self, name: str, done: int, total: int, told: str = "") -> None:
        if name not in self._tasks:
            self._bars.start()
            self._tasks[name] = self._bars.add_task(name, total=total, told=told)
        self._bars.update(self._tasks[name], completed=done, total=total, told=told)

    def _say(self, line: str) -> None:
        self._console.print(line, markup=False)


class _PerhapsUnread:
    """A stream to which writing is no error, though nothing may take it any more."""

    def __init__(self, stream: IO[str]) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        with contextlib.suppress(OSError):
            self._stream.write(text)
        return len(text)

    def flush(self) -> None:
        with contextlib.suppress(OSError):
            self._stream.flush()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)
