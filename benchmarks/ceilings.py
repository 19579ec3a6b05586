"""How well a policy can do that knows no more than an agent is shown: `make ceilings`.

For each kind of knowledge in the tasks with new phantoms: with memory, the exact best return; with the last
frames alone, a return that some policy reaches. Eyes are ideal, or those of real frames of training phantoms,
which are simulated first (some minutes). All without noise.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from usbench.atomic import atomic_file
from usbench.envs.bmode import DEFAULT_IMAGING
from usbench.envs.ceilings import beliefs, eyes, hypotheses, memoryless
from usbench.envs.frames import frame_store
from usbench.envs.probe import DEFAULT_ARRAY
from usbench.envs.tasks.random_phantoms import PROBE_PLANE_RANDOM, ProbePlaneRandomEnv

DISTRIBUTION = ProbePlaneRandomEnv.distribution
TRACKED = ("position", "heading")


@dataclass(frozen=True)
class Knowledge:
    """What a policy knows; no number of frames stands for all of them, with all actions."""

    words: str
    senses: tuple[str, ...] = ()
    n_frames: int | None = None
    with_actions: bool = False


KINDS = (
    Knowledge("1 frame", n_frames=1),
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
        return known.score(beliefs.best_return(known, kind.senses))
    past = memoryless.histories(known, kind.senses, kind.n_frames, kind.with_actions)
    n_steps = known.task.n_steps
    found = [memoryless.found_return(past, n_steps, np.random.default_rng(k)) for k in range(beginnings)]
    return known.score(max(found))


def real_eyes(ideal: hypotheses.Hypotheses, n_phantoms: int, error: float) -> hypotheses.Hypotheses:
    """Return what the frames of the first training phantoms let tell apart."""
    phantoms = [DISTRIBUTION.phantom(seed) for seed in range(n_phantoms)]
    stores = [frame_store(phantom, DEFAULT_ARRAY, DEFAULT_IMAGING) for phantom in phantoms]
    for store in track(stores, "simulating frames of training phantoms"):
        store.prepare(ideal.task.states)
    return eyes.seen_by_real_eyes(ideal, phantoms, stores, error)


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

    ideal = hypotheses.of_distribution(PROBE_PLANE_RANDOM, DISTRIBUTION)
    observers = {"ideal eyes": ideal}
    if args.phantoms:
        observers["eyes of real frames"] = real_eyes(ideal, args.phantoms, args.error)
    table = Table(
        "the policy knows", *observers, "kind", title="pp-random, pp-tracked: largest scores, noise 0"
    )
    rows = [
        "knowledge,senses,n_frames,actions,kind," + ",".join(name.replace(" ", "_") for name in observers)
    ]
    for kind in track(KINDS, "policies"):
        scores = [f"{ceiling(kind, known, args.beginnings):.3f}" for known in observers.values()]
        words = "exact" if kind.n_frames is None else "at least"
        table.add_row(kind.words, *scores, words)
        shown = "all" if kind.n_frames is None else str(kind.n_frames)
        rows.append(
            ",".join(
                [
                    kind.words.replace(",", ""), " ".join(kind.senses), shown,
                    str(kind.n_frames is None or kind.with_actions), words, *scores,
                ]
            )
        )  # fmt: skip
    Console(width=110).print(table)
    if args.csv:
        with atomic_file(args.csv) as file:
            file.write(("\n".join(rows) + "\n").encode())


if __name__ == "__main__":
    main()
