"""The command `usbench`: Ctrl-C is understood from the first moment, while the package is imported."""

import sys


def main() -> int:
    """Run the command line; return its exit status."""
    try:
        from usbench.cli import main as run
    except KeyboardInterrupt:
        print("usbench: interrupted before anything had begun.", file=sys.stderr)
        return 130
    return run()
