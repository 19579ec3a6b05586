"""Build the trained agents that come with the package again, from trials: `make release-agents`."""

import argparse
import sys
from pathlib import Path

from usbench.compare import release


def main() -> None:
    """Write usbench/trained from the trials that are named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("runs", nargs="*", type=Path, default=[Path("runs")], help="(default runs)")
    for folder in release.write(parser.parse_args().runs, tell=lambda line: print(line, file=sys.stderr)):
        size = sum(path.stat().st_size for path in folder.iterdir())
        print(f"{folder.name}: {size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
