"""`usbench defaults`: write a file of the probe or of the imaging, to start from."""

import argparse
from typing import Any

EXAMPLES = """examples:
  usbench defaults probe > probe.toml
  usbench defaults imaging > imaging.toml
  usbench defaults l7-4 > probe.toml
      a probe of usbench list, with the sources of its values
  usbench run --algo dqn --task pp --probe probe.toml --imaging imaging.toml
"""


def add(subparsers: Any, debug: argparse.ArgumentParser) -> None:
    """Add the command to the command line; `debug` is what all commands share."""
    defaults = subparsers.add_parser(
        "defaults",
        parents=[debug],
        epilog=EXAMPLES,
        help="print the default probe or imaging, or a probe by name, as a file to start from",
        description="Print every field of the probe or of the imaging with its default, or the fields of a "
        "probe of usbench list, as a TOML file for the options --probe and --imaging. Fields that you remove "
        "keep their defaults.",
    )
    defaults.add_argument("kind", metavar="KIND", help="probe, imaging, or a probe of usbench list")
    defaults.set_defaults(call=_call)


def _call(args: argparse.Namespace) -> None:
    from usbench.setting_parts import toml_files

    print(toml_files.defaults(args.kind), end="")
