"""Accuracy and speed of the simulator, as a table: `make bench-sim`.

Accuracy means: compared with RF of an independent code (esdiva 0.3.0, the Field II method), of which eight
lines are in tests/reference; where all 64 lines lie beside the repository, all are compared. The ratio of the
speeds needs esdiva itself, which the extra `bench` installs. The engine before the present one is taken from
the history of the repository, zea from an installation of yours (`pip install zea==0.1.8`).
"""

from __future__ import annotations

import argparse
import importlib.util
import sys
from itertools import chain

from rich.console import Console
from rich.table import Table
from simulation import accuracy, many_points, rivals, speed
from simulation.measuring import reached


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--all-frames", action="store_true", help="only simulate all frames, in this process")
    parser.add_argument(
        "--throughput", action="store_true", help="only few and many scatterers, in this process"
    )
    parser.add_argument(
        "--probes", action="store_true", help="only the tables of the default probe and of those with a name"
    )
    parser.add_argument(
        "--repeats", type=int, default=15, help="frames per focal depth and round (default 15)"
    )
    args = parser.parse_args()
    if args.all_frames:
        speed.all_frames()
        return
    if args.throughput:
        for row in chain(*(part() for part in many_points.PARTS)):
            print(*row, sep="\t", flush=True)
        return
    if args.probes:
        for row in accuracy.probes():
            print(*row, sep="\t", flush=True)
        return
    table = Table("what", "measured", "asked", "reached", title="The simulator")
    parts = [
        *(accuracy.accuracy(), accuracy.probes(), rivals.engines(), speed.speed(args.repeats)),
        *(speed.environments(args.repeats), speed.scaling(), many_points.apart(), speed.from_nothing()),
    ]
    has_esdiva = importlib.util.find_spec("esdiva") is not None
    if has_esdiva:
        parts.append(rivals.ratio())
    has_zea = importlib.util.find_spec("zea") is not None
    if has_zea:
        parts.append(rivals.ratio_to_zea())
    for part in parts:
        for what, measured, asked in part:
            row = (what, measured, asked, reached(measured, asked))
            table.add_row(*row)
            print(*row, sep="\t", file=sys.stderr, flush=True)  # the whole takes half an hour
        table.add_section()
    Console(width=110).print(table)
    if not has_esdiva:
        print("No ratio to esdiva: it is not installed (pip install -e '.[bench]').")
    if not has_zea:
        print("No ratio to zea: it is not installed (pip install zea==0.1.8).")


if __name__ == "__main__":
    main()
