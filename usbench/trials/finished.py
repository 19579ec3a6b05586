"""Whether a trial is finished, and what it left is still what it wrote."""

import zipfile
from pathlib import Path

from usbench import records
from usbench.agents import zoo
from usbench.records import Trial, TrialConfig, checksums


def find_finished(config: TrialConfig, out: Path) -> Trial | None:
    """Return the trial in the folder `out` if it is finished, else None.

    TensorBoard's events are not looked at: nothing is made from them.

    Raises:
        ValueError: If its files were damaged; one sentence says which.
    """
    folder = out / config.folder_name
    # The record first: of a trial that another process ends meanwhile, all else is whole by then.
    trial = Trial.find(folder)
    if trial is None or trial.status != "finished":
        return None
    checksums.check(folder, trial.checksums)
    # Algorithms of other packages write what they like.
    model_is_whole = not zoo.is_of_the_package(config.algo) or _is_whole_zip(folder / records.MODEL)
    for name, is_whole in (
        (records.TRIAL, trial.config.hash == config.hash),
        (records.MODEL, model_is_whole),
    ):
        if not is_whole:
            raise checksums.damaged(folder / name)
    return trial


def _is_whole_zip(path: Path) -> bool:
    try:
        with zipfile.ZipFile(path) as archive:
            return archive.testzip() is None
    except Exception:  # whatever stands in the file
        return False
