"""How well a policy can do that knows no more than an agent is shown: `make ceilings`.

For each kind of knowledge in the tasks with new phantoms: with memory, the exact best return; with the last
frames alone, a return that some policy reaches. Eyes are ideal, or those of real frames of training phantoms,
which are simulated first. With noise, or where the focus moves, policies that are told the whole pose; eyes
are then those of frames with the focus in the middle of the objects' depths. It takes half an hour.
"""

from __future__ import annotations

import argparse
import csv
import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import ClassVar

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from usbench.atomic import atomic_file
from usbench.envs.bmode import DEFAULT_IMAGING
from usbench.envs.ceilings import beliefs, eyes, hypotheses, memoryless, teacher
from usbench.envs.frames import frame_store
from usbench.envs.probe import DEFAULT_ARRAY
from usbench.envs.tasks.phantom_distribution import PhantomDistribution
from usbench.envs.tasks.random_examination import ExaminationTrackedEnv
from usbench.envs.tasks.random_phantoms import (
    PROBE_PLANE_RANDOM,
    FocalPointRandomEnv,
    ProbePlaneRandomEnv,
    ProbePlaneTrackedEnv,
    RandomPhantomEnv,
)

DISTRIBUTION = ProbePlaneRandomEnv.distribution
TRACKED = ("position", "heading")
NOISY = (0.25, 0.5)
NOISES = (0.0, *NOISY)
# Tasks whose policies are told the whole pose: names, environment, senses, noises. KINDS have the probe plane
# without noise.
TRACKED_TASKS: tuple[tuple[str, type[RandomPhantomEnv], tuple[str, ...], tuple[float, ...]], ...] = (
    ("pp-random pp-tracked", ProbePlaneTrackedEnv, TRACKED, NOISY),
    ("fp-random", FocalPointRandomEnv, ("position", "focus"), NOISES),
    ("exam-random exam-tracked", ExaminationTrackedEnv, ("position", "focus", "heading"), NOISES),
)


@dataclass(frozen=True)
class Knowledge:
    """What a policy knows; no number of frames stands for all of them, with all actions."""

    words: str
    senses: tuple[str, ...] = ()
    n_frames: int | None = None
    with_actions: bool = False


@dataclass(frozen=True)
class Row:
    """A row of the table: the largest score for a kind of knowledge, and of which kind the number is."""

    COLUMNS: ClassVar[tuple[str, ...]] = (
        "tasks", "noise", "knowledge", "senses", "n_frames", "actions", "kind", "ideal_eyes",
        "eyes_of_real_frames",
    )  # fmt: skip

    tasks: str
    noise: float
    knows: Knowledge
    kind: str
    ideal_eyes: float
    eyes_of_real_frames: float | None = None

    @property
    def scores(self) -> tuple[str, str]:
        """Both scores as they are printed."""
        real = self.eyes_of_real_frames
        return f"{self.ideal_eyes:.3f}", "" if real is None else f"{real:.3f}"

    def values(self) -> tuple[object, ...]:
        """Return the values of the columns."""
        n_frames = self.knows.n_frames
        return (
            self.tasks, self.noise, self.knows.words, " ".join(self.knows.senses), n_frames or "all",
            n_frames is None or self.knows.with_actions, self.kind, *self.scores,
        )  # fmt: skip


KINDS = (
    Knowledge("1 frame", n_frames=1),
    Knowledge("1 frame and the action before it", n_frames=1, with_actions=True),
    Knowledge("2 frames", n_frames=2),
    Knowledge("2 frames and the action between them", n_frames=2, with_actions=True),
    Knowledge("3 frames and the actions between them", n_frames=3, with_actions=True),
    Knowledge("all frames and actions"),
    Knowledge("1 frame and the heading", ("heading",), 1),
    Knowledge("1 frame, heading and position", TRACKED, 1),
    Knowledge("all frames and actions, and the heading", ("heading",)),
    Knowledge("all frames and actions, and the position", ("position",)),
    Knowledge("all frames and actions, heading and position", TRACKED),
)


def ceiling(kind: Knowledge, known: hypotheses.Hypotheses, beginnings: int) -> float:
    """Return the score that the best policy with this knowledge reaches, or the best that was found."""
    if kind.n_frames is None:
        return known.anchors.score(beliefs.best_return(known, kind.senses))
    past = memoryless.histories(known, kind.senses, kind.n_frames, kind.with_actions)
    n_steps = known.task.n_steps
    found = [memoryless.found_return(past, n_steps, np.random.default_rng(k)) for k in range(beginnings)]
    return known.anchors.score(max(found))


def real_eyes(
    ideal: hypotheses.Hypotheses, distribution: PhantomDistribution, n_phantoms: int, error: float
) -> hypotheses.Hypotheses:
    """Return what the frames of the first training phantoms let tell apart."""
    phantoms = [distribution.phantom(seed) for seed in range(n_phantoms)]
    stores = [frame_store(phantom, DEFAULT_ARRAY, DEFAULT_IMAGING) for phantom in phantoms]
    for store in track(stores, "simulating frames of training phantoms"):
        store.prepare(ideal.task.states)
    return eyes.seen_by_real_eyes(ideal, phantoms, stores, error)


def untold_rows(n_phantoms: int, error: float, beginnings: int) -> Iterator[Row]:
    """Yield the rows of the probe plane without noise, with both kinds of eyes."""
    ideal = hypotheses.of_distribution(PROBE_PLANE_RANDOM, DISTRIBUTION)
    observers = [ideal, real_eyes(ideal, DISTRIBUTION, n_phantoms, error)] if n_phantoms else [ideal]
    for kind in track(KINDS, "policies"):
        scores = tuple(ceiling(kind, known, beginnings) for known in observers)
        words = "exact" if kind.n_frames is None else "at least"
        yield Row("pp-random pp-tracked", 0.0, kind, words, *scores)


def tracked_rows(n_phantoms: int, error: float) -> Iterator[Row]:
    """Yield the rows of who knows the probe's pose, with both kinds of eyes."""
    for tasks, env, senses, noises in TRACKED_TASKS:
        kind = Knowledge(
            f"all frames and actions, {' and '.join((', '.join(senses[:-1]), senses[-1]))}", senses
        )
        real = partial(real_eyes, distribution=env.distribution, n_phantoms=n_phantoms, error=error)
        observers = [None, real] if n_phantoms else [None]
        for noise in track(noises, tasks):
            scores = (
                teacher.Teacher(env.task, env.distribution, senses, noise, one).best_score
                for one in observers
            )
            yield Row(tasks, noise, kind, "exact", *scores)


def write(path: Path, rows: Sequence[Row]) -> None:
    """Write the table as CSV."""
    with atomic_file(path) as file, io.TextIOWrapper(file, encoding="utf-8", newline="") as text:
        lines = csv.writer(text, lineterminator="\n")
        lines.writerow(Row.COLUMNS)
        lines.writerows(row.values() for row in rows)


def main() -> None:
    """Print the table, and write it as a file where one is named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--phantoms", type=int, default=60, help="training phantoms (default 60; 0 for none)")
    parser.add_argument(
        "--error", type=float, default=0.1, help="of a decision between two poses that look alike (0.1)"
    )
    parser.add_argument("--beginnings", type=int, default=3, help="of each search for a policy (default 3)")
    parser.add_argument("--csv", type=Path, help="file to write")
    args = parser.parse_args()

    eyes_of = (args.phantoms, args.error)
    rows = [*untold_rows(*eyes_of, args.beginnings), *tracked_rows(*eyes_of)]
    table = Table(
        "tasks",
        "noise",
        "the policy knows",
        "ideal eyes",
        "eyes of real frames",
        "kind",
        title="largest scores",
    )
    for row in rows:
        table.add_row(row.tasks, f"{row.noise:g}", row.knows.words, *row.scores, row.kind)
    Console(width=130).print(table)
    if args.csv:
        write(args.csv, rows)


if __name__ == "__main__":
    main()
