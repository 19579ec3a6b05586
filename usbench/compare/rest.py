"""The rows of a further table that names some: these, and the best of the others by the complete grid."""

from pathlib import Path

import pandas as pd

from usbench.compare import plan
from usbench.compare.protocol import Protocol
from usbench.records import ConfigurationError
from usbench.results import additions, collecting, ranking, scores, tables
from usbench.results.tables import Results


def rows(protocol: Protocol, table: str | None, out: Path, folder: Path) -> tuple[str, ...] | None:
    """Return the algorithms of a further table; None where it takes those of the grid.

    Args:
        protocol: The protocol.
        table: Name of the table; None for the grid.
        out: Folder with the grid's trials, if they are here.
        folder: Folder of the tables of a leaderboard that may have them, too.

    Raises:
        ConfigurationError: If there is no such table, or it waits for the grid.
        ValueError: If records are damaged.
    """
    named = None if table is None else protocol.comparison.extra(table).rows
    if named is None:
        return None
    known, n_planned = _grid(protocol, out, folder)
    finished = int((known.trials["status"] == "finished").sum())
    if finished < n_planned:
        raise ConfigurationError(
            f"the table {table} takes the best of the other rows by the grid, of which {finished} of "
            f"{n_planned} trials are finished in {str(out)!r} and {str(folder)!r}: run what is missing of "
            "the grid first, or begin where its tables are, as in a clone."
        )
    ranked = ranking.overall(scores.learners(known))["agent"]
    others = [agent for agent in ranked if agent in protocol.comparison.rows and agent not in named]
    return (*named, *others[:1])


def _grid(protocol: Protocol, out: Path, folder: Path) -> tuple[Results, int]:
    """Return what there is of the grid, from its trials or from tables, and how many trials it has."""
    planned = plan.by_protocol(protocol)
    names = [config.folder_name for config in planned]
    nothing = Results(
        *(pd.DataFrame(columns=list(each)) for each in (tables.TRIAL_COLUMNS, tables.CURVE_COLUMNS))
    )
    here = collecting.collect(out, planned) if out.is_dir() else nothing
    kept = tables.read(folder) if (folder / tables.TRIALS).exists() else nothing
    known = additions.joined(kept, here)
    return known.of(known.trials[known.trials["trial"].isin(names)]), len(planned)
