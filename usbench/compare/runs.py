"""From folders of trials to the tables of a leaderboard."""

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import pandas as pd

from usbench import records
from usbench.figures import comparison
from usbench.own_task import is_on_its_task
from usbench.records import ConfigurationError, TrialConfig
from usbench.records.lock import locked
from usbench.results import additions, collecting, held_out, leaderboard, studies, tables
from usbench.results.tables import Results


def gather(runs: Path) -> tuple[Results, pd.DataFrame]:
    """Return the results of all trials in `runs` that can be compared, and the rows of the others.

    The others have another environment than their task's: a custom anatomy, another probe, imaging or reward,
    or senses that the task does not have. Agents may be told less, and their own last actions.

    Raises:
        ConfigurationError: If there is no trial, or one is on a task that is not installed.
        FileNotFoundError: If there is no such folder.
        ValueError: If a record is broken.
    """
    known = collecting.collect(runs)
    if known.trials.empty:
        found = ", ".join(folder.name for folder in studies.folders(runs))
        alone = f", only what usbench report shows, studies ({found})" if found else ""
        raise ConfigurationError(
            f"there is no trial in {str(runs)!r}{alone}: usbench run and usbench compare make some."
        )
    own = {trial.name: is_on_its_task(trial.config) for trial in records.load_trials(runs)}
    fits = known.trials["trial"].map(own)
    return known.of(known.trials[fits]), known.trials[~fits]


def place(
    usual: Path,
    out: Path,
    names: Iterable[str],
    tell: Callable[[str], None] = lambda _: None,
    *,
    named: Path | None = None,
    with_studies: bool = False,
) -> Path:
    """Return where the leaderboard of the trials `names` goes: to the file that is `named`, or to `usual`.

    Where the tables beside `usual` would lose trials that are not among `names` and have no folder in `out`,
    as in a clone those of the benchmark's own leaderboard, or, `with_studies`, studies that have none there,
    it goes to `out / usual`; so it does where a file of this name is a user's own. A file that is named is
    taken in any case. `tell` is told of each.
    """
    path = named or usual
    if foreign := None if named else _foreign(usual):
        tell(f"{foreign} is not of usbench: this leaderboard goes to {out / usual}")
        return out / usual
    if not _would_lose(path, out, names, with_studies):
        return path
    held = f"{path} holds trials or studies that are not in {out}"
    if named is not None:
        tell(f"{held}: this leaderboard takes their place")
        return named
    tell(f"{held}: this leaderboard goes to {out / usual}")
    return out / usual


def _foreign(board: Path) -> Path | None:
    """Return a file in the place of a leaderboard, or of its scores, that begins otherwise than these do."""
    for path, beginning in ((board, leaderboard.TITLE), (leaderboard.scores_file(board), "table,")):
        if path.is_file() and not path.read_bytes().startswith(beginning.encode()):
            return path
    return None


def _would_lose(board: Path, out: Path, names: Iterable[str], with_studies: bool) -> bool:
    """Return whether tables beside `board` hold trials, or studies, neither among `names` nor in `out`."""
    folder = leaderboard.files(board)
    try:
        kept = tables.read(folder).trials
        own = {studies.folder_of(out, name) for name in studies.read(folder)["study"] if with_studies}
    except (FileNotFoundError, NotADirectoryError, ValueError):  # nothing there that could be lost
        return False
    learned = (kept["steps"] > 0) & (kept["status"] == "finished")
    others = {out / name for name in set(kept.loc[learned, "trial"]) - set(names)} | own
    return not all(path.exists() for path in others)


def write_tables(known: Results, folder: Path) -> None:
    """Write the tables of a leaderboard, and forget tests and marks of trials that were trained anew.

    A trial that the tables before did not have may have left them once, and come back with other numbers.
    """
    with locked(folder / tables.TRIALS):
        try:
            before = tables.read(folder)
        except (FileNotFoundError, ValueError):  # no tables, or none that can be read
            before = None
        if before is not None:
            anew = [one.trial for one in additions.repeated(before, known)[1]]
            anew += sorted(set(known.trials["trial"]) - set(before.trials["trial"]))
            held_out.forget(folder, anew)
            additions.mark_unverified(folder, anew, ())
        tables.write(known, folder)


def report(planned: Sequence[TrialConfig], out: Path, path: Path) -> list[Path]:
    """Write leaderboard, scores, tables and figures from the records in `out`; return where they are.

    Only the planned trials count; those without a finished record are named in the leaderboard.
    """
    folder = leaderboard.prepare(path)
    known = collecting.collect(out, planned)
    write_tables(known, folder)
    # First: the page shows those that there are.
    figures = comparison.write(known, folder)
    return [*leaderboard.write(folder, path), *figures]
