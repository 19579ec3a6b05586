"""Whether a trial is finished, and what it left is still what it wrote."""

import zipfile
from pathlib import Path

from usbench import records
from usbench.agents import zoo
from usbench.records import Trial, TrialConfig, checksums
from usbench.trials.resume_files import Checkpoints


def is_finished(config: TrialConfig, out: Path) -> bool:
    """Return whether a trial is finished in the folder `out`; what it needs no more is removed.

    TensorBoard's events are not looked at: nothing is made from them.

    Raises:
        ValueError: If its files were damaged; one sentence says which.
    """
    folder = out / config.folder_name
    trial = Trial.find(folder)
    if trial is None or trial.status != "finished":
        return False
    if trial.config.hash != config.hash:
        raise checksums.damaged(folder / records.TRIAL)
    checksums.check(folder, trial.checksums)
    # Agents from outside write what they like.
    if config.algo in zoo.ZOO and not _is_whole_zip(folder / records.MODEL):
        raise checksums.damaged(folder / records.MODEL)
    Checkpoints(folder, 0.0).clear()
    return True


def _is_whole_zip(path: Path) -> bool:
    try:
        with zipfile.ZipFile(path) as archive:
            return archive.testzip() is None
    except Exception:  # whatever stands in the file
        return False
