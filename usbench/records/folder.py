"""The folder of a trial: made, found again, and the errors where there is none.

A trial folder holds `trial.json` (resolved configuration, versions, hash of the frames, status, anchors),
`episodes.jsonl` (one line per training episode), `evaluations.jsonl` (one line per evaluation episode),
`model.zip` and TensorBoard events; while it runs, `checkpoints` too. `usbench run` draws two pictures beside
them, `replay.gif` and `learning_curve.png`.
"""

import os
import re
import shutil
import tempfile
from collections.abc import Collection
from pathlib import Path

from usbench.atomic import atomic_file, remove_leftovers
from usbench.checks import ConfigurationError, did_you_mean
from usbench.records.configuration import TrialConfig

TRIAL, EPISODES, EVALUATIONS, MODEL = "trial.json", "episodes.jsonl", "evaluations.jsonl", "model.zip"
# The weights of a released agent, as plain arrays; see `usbench.released`.
WEIGHTS = "weights.npz"
TENSORBOARD, CHECKPOINTS = "tensorboard", "checkpoints"
REPLAY, LEARNING_CURVE = "replay.gif", "learning_curve.png"
_EARLIER = re.compile(r"\.earlier-\d+$")


def create(out: Path, config: TrialConfig) -> Path:
    """Make an empty trial folder and return its path; an earlier one with training episodes stays beside it.

    Raises:
        ConfigurationError: If the folder cannot be made or written.
    """
    folder = out / config.folder_name
    try:
        out.mkdir(parents=True, exist_ok=True)
        remove_leftovers(folder)
        if folder.exists() and _has_episodes(folder):
            _put_aside(folder)
        elif folder.exists():
            _empty(folder)
        folder.mkdir(exist_ok=True)
        with atomic_file(folder / TRIAL) as file:
            file.write(b"{}\n")
    except OSError as error:
        raise unwritable(out, error) from error
    return folder


def check_writable(folder: Path, what: str = "output folder") -> None:
    """Refuse a folder, which need not be there yet, before long work rather than after.

    Raises:
        ConfigurationError: If nothing can be written there, nor where it would be made.
    """
    there = next(place for place in (folder.absolute(), *folder.absolute().parents) if os.path.exists(place))
    try:
        if not there.is_dir():
            raise NotADirectoryError(None, f"{str(there)!r} is a file")
        with tempfile.TemporaryFile(dir=there):
            pass
    except OSError as error:
        raise unwritable(folder, error, what) from error


def unwritable(out: Path, error: OSError, what: str = "output folder") -> ConfigurationError:
    """Return the error for a folder that cannot be written; `what` it is."""
    return ConfigurationError(
        f"the {what} {str(out)!r} cannot be written ({error.strerror}): choose another folder."
    )


def _has_episodes(folder: Path) -> bool:
    """Return whether a trial recorded a training episode in `folder`, or somebody has put files there."""
    sizes = {path.name: path.stat().st_size for path in folder.iterdir()}
    made = {TRIAL, EPISODES, EVALUATIONS, MODEL, TENSORBOARD, CHECKPOINTS, REPLAY, LEARNING_CURVE}
    return not sizes.keys() <= made or bool(sizes.get(EPISODES))


def _put_aside(folder: Path) -> None:
    """Rename the folder of an earlier attempt to the first free `<name>.earlier-<number>`."""
    number = 1
    while (earlier := folder.with_name(f"{folder.name}.earlier-{number}")).exists():
        number += 1
    folder.rename(earlier)


def _empty(folder: Path) -> None:
    """Remove what a trial left that had no training episode."""
    for path in folder.iterdir():
        shutil.rmtree(path) if path.is_dir() else path.unlink()


def trial_folders(runs: Path) -> list[Path]:
    """Return the trial folders in `runs`, which may be one itself; earlier attempts are left out."""
    if (runs / TRIAL).exists():
        # Resolved, so that a trial has its name where it is given as "." too.
        candidates = [runs.resolve() if runs.name in ("", "..") else runs]
    else:
        candidates = sorted(path.parent for path in runs.glob(f"*/{TRIAL}"))
    return [folder for folder in candidates if not _EARLIER.search(folder.name)]


def without_record(runs: Path) -> list[Path]:
    """Return the folders in `runs`, which is no trial itself, with files of a trial, but no `trial.json`."""
    # Studies have evaluations, too.
    begun = {path.parent for name in (EPISODES, MODEL) for path in runs.glob(f"*/{name}")}
    return sorted(folder for folder in begun if not (folder / TRIAL).exists())


def existing(runs: Path, names: Collection[str] = ()) -> Path:
    """Return `runs` if it is a folder.

    Args:
        runs: Where trials are to be.
        names: What else may be named in its place; one that is much like `runs` is asked for.

    Raises:
        FileNotFoundError: If not.
    """
    if runs.is_dir():
        return runs
    if runs.exists():
        raise FileNotFoundError(f"{str(runs)!r} is a file, not a folder with trials.")
    hint = did_you_mean(runs, names, cutoff=0.8)
    raise FileNotFoundError(f"there is no folder {str(runs)!r} with trials{hint}.")


def no_trial(folder: Path) -> ConfigurationError:
    """Return the error for a `folder` that holds no trial, or that is not there."""
    if (folder / TRIAL).is_file():  # of one that was killed in its first moment
        why = f"its {TRIAL} holds none"
    elif folder.is_dir():
        why = f"no {TRIAL} in it"
    else:
        why = "it is a file" if folder.exists() else "it does not exist"
    return ConfigurationError(f"{str(folder)!r} is not the folder of a trial: {why}.")


def model_in(folder: Path) -> Path:
    """Return the file of the agent's weights in a trial folder: of a released agent, else of the trial."""
    released = folder / WEIGHTS
    return released if released.is_file() else folder / MODEL
