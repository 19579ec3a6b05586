"""The file that a snapshot is written to: its name, and numbers or a picture in it."""

from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from usbench.atomic import atomic_file
from usbench.envs.pose import Pose
from usbench.envs.settings import in_words
from usbench.figures import style
from usbench.records import ConfigurationError
from usbench.watch import snapshot_figure, uff
from usbench.watch.snapshot import Snapshot
from usbench.watch.snapshot_option import Source

FORMATS = (".png", ".npy", ".npz", ".uff")


def path(out: Path | None, kind: str, source: Source, pose: Pose, *, plain: bool = False) -> Path:
    """Return the file to write, named after source and pose unless `out` says its name.

    Raises:
        ConfigurationError: If its ending is not one of FORMATS, its folder does not exist, or `plain`, which
            is for the pixels of a frame, is asked of something else.
    """
    if out is None:
        where = f"x{pose.x_mm}_depth{pose.focal_depth_mm}_angle{pose.angle_deg}"
        settings = [word.replace(" ", "") for word in in_words(pose)]
        out = Path("_".join([kind, *source.names, where, *settings]) + ".png")
    style.check_file(out, FORMATS)
    if plain and (kind != "frame" or out.suffix != ".png"):
        raise ConfigurationError("only a frame as .png has bare pixels: everything else has none to show.")
    if kind == "iq" and out.suffix == ".png":
        raise ConfigurationError(
            "I/Q has no picture of its own, which is that of the envelope: write .npy, .npz or .uff."
        )
    if out.suffix == ".uff":
        uff.check_installed()
    return out


def write(taken: Snapshot, path: Path, *, plain: bool = False) -> None:
    """Write numbers (.npy), also with where they lie (.npz, .uff), the figure or `plain` pixels (.png)."""
    if path.suffix == ".npy":
        with atomic_file(path) as file:
            np.save(file, taken.values)
    elif path.suffix == ".npz":
        with atomic_file(path) as file:
            arrays: dict[str, Any] = {taken.kind: taken.values, "x": taken.x, "z": taken.z}
            arrays["sampling_frequency"] = taken.sampling_frequency
            arrays["focal_depth"] = taken.pose.focal_depth_mm * 1e-3
            np.savez(file, **arrays)
    elif path.suffix == ".uff":
        uff.write(taken, path)
    elif plain:
        with atomic_file(path) as file:
            Image.fromarray(taken.values).save(file, format="PNG")
    else:
        style.save(snapshot_figure.figure(taken), path)
