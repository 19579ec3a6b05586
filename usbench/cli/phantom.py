"""The option `--phantom`: a custom anatomy from the words of a command."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from usbench.cli.arguments import each_once, number, setting

if TYPE_CHECKING:
    from usbench.envs.anatomy import Anatomy


def add_phantom(parser: argparse.ArgumentParser, target: str = "") -> None:
    """Add the option for a custom anatomy; `target` says what is to be known of its target."""
    parser.add_argument(
        "--phantom",
        nargs="+",
        default=[],
        metavar=("FILE", "NAME=VALUE"),
        help="a 3-D image (.nii, .mha, .nrrd) in place of the phantom, needs usbench[anatomy]: "
        "frames=simulated (default) or recorded, lateral=x, down=z, center_x_mm, center_y_mm, skin_mm, seed, "
        "density_per_mm3, dynamic_range_db, attenuation_db_per_cm_mhz"
        f"{'; ' if target else ''}{target}",
    )


def custom_anatomy(words: Sequence[str], *, looking: bool = False) -> "Anatomy | None":
    """Return the anatomy of the option --phantom, None without it; errors are those of `read`."""
    from usbench.records import ConfigurationError
    from usbench.setting_parts import anatomy_record

    if not words:
        return None
    path, *settings = words
    try:
        pairs = [setting(text) for text in settings]
    except argparse.ArgumentTypeError as error:
        raise ConfigurationError(f"--phantom takes FILE NAME=VALUE ..: {error}.") from error
    values = {name: number(value) for name, value in each_once("--phantom", pairs).items()}
    return anatomy_record.read(Path(path), values, looking=looking)
