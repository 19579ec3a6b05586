"""`usbench defaults`: write a file with every field of the probe or of the imaging, to start from."""

import argparse
from typing import Any

EXAMPLES = """examples:
  usbench defaults probe > probe.toml
  usbench defaults imaging > imaging.toml
  usbench run --algo dqn --task pp --probe probe.toml --imaging imaging.toml
"""


def add(subparsers: Any, debug: argparse.ArgumentParser) -> None:
    """Add the command to the command line; `debug` is what all commands share."""
    defaults = subparsers.add_parser(
        "defaults",
        parents=[debug],
        epilog=EXAMPLES,
        help="print the defaults of the probe or of the imaging as a file to start from",
        description="Print every field of the probe or of the imaging with its default, as a TOML file for "
        "the options --probe and --imaging. Fields that you remove keep their defaults.",
    )
    defaults.add_argument("kind", metavar="KIND", help="probe or imaging")
    defaults.set_defaults(call=_call)


def _call(args: argparse.Namespace) -> None:
    from usbench import setting_files

    print(setting_files.defaults(args.kind), end="")
