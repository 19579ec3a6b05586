"""Results in, a leaderboard and its table of scores out: same results, same bytes."""

import contextlib
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import pandas as pd

from usbench.anchors import Anchors
from usbench.atomic import atomic_file
from usbench.records import ConfigurationError
from usbench.results import (
    additions,
    captions,
    held_out,
    provenance,
    ranking,
    scores,
    studies,
    tables,
    text,
    together,
    verdict,
)
from usbench.results.protocol import further, tuning, unseen
from usbench.results.scores import CELL, ROW, SCORED, Cell
from usbench.results.tables import SAMPLED, Results
from usbench.results.text import DASH
from usbench.tasks import row_of

SCORES = "scores.csv"
USUAL, ENDING = "leaderboard", ".md"
# With which a leaderboard begins.
TITLE = "# Leaderboard"
# Title, column of `scores.cells`, factor, digits.
RETURN, SUCCESS = ("return", "return", 1, 2), ("success (%)", "success_rate", 100, 0)
MEASURES = """\
Tables of single cells have the score with greedy and with sampled actions, the return and the success;
those of the further table on new phantoms have the ceiling and what agents learned with in place of
sampled actions and return.
`{scores}` has sampled actions and return of all cells, distance, plane error, steps to goal, area under the
curve and training time, too."""

READING = """\
The normalised score is (return - random) / (optimal - random), with exact anchors: 0 is a random agent,
1 the optimum. It is the interquartile mean (IQM) over seeds after the last training step, with the 95 %
stratified bootstrap interval; such intervals are too narrow with few seeds (docs/comparison.md says how
much). All agents meet the same evaluation episodes with the same draws of noise, and the intervals are
for these. The scores 0 and 1 are those of expected returns, means over all draws of noise. With the
draws of these episodes the optimum has the score of the row `oracle`, which is not always 1, and the
random agent that of the row `random`, so that an agent can have a higher score than the oracle. Every
agent takes its greedy action: the one that it finds most probable or, if it is value-based, the one that
it values most; advice should be the best there is. The score with sampled actions stands beside it, where
there are probabilities to draw from.
Other columns are means over seeds and evaluation episodes, so that a single collapsed seed shows there
rather than in the score. The plane error is counted modulo 180 degrees; success means that the last pose
is the goal (in `setup`, that the cyst's contrast-to-noise ratio is at least 2); an episode that never
reaches the goal counts with all the steps it could have had in "steps to goal". The area under the
learning curve is the mean score over training, by the trapezoid rule. The optimality gap is the mean of
what scores lack to 1, where more than 1 counts as 1. Training time is CPU time. A dash stands where a
column says nothing about a task."""


def files(path: Path) -> Path:
    """Return the folder of the tables and figures that belong to the leaderboard `path`."""
    return path.with_name(f"{path.stem}_files")


def scores_file(path: Path) -> Path:
    """Return the table of scores beside the leaderboard `path`: leaderboards in one folder share none."""
    return path.with_name(SCORES if path.stem == USUAL else f"{path.stem}_{SCORES}")


def prepare(path: Path) -> Path:
    """Return the folder for the tables and figures beside the leaderboard `path`, made if need be.

    Raises:
        ConfigurationError: If nothing can be written there; better before hours of trials than after.
    """
    if path.suffix != ENDING:
        raise ConfigurationError(f"the name of the leaderboard must end with {ENDING}, not {str(path)!r}.")
    try:
        if path.is_dir():
            raise IsADirectoryError(None, "it is a folder")
        folder = files(path)
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigurationError(
            f"the leaderboard {str(path)!r} cannot be written ({error.strerror}): choose another file."
        ) from error
    return folder


@contextlib.contextmanager
def prepared(path: Path) -> Iterator[Path]:
    """Prepare the folder beside the leaderboard `path`, and take it away again if an error leaves it empty.

    Raises:
        ConfigurationError: If nothing can be written there.
    """
    places = () if path.is_dir() else (files(path), *path.parents)
    made = [one for one in places if not one.exists()]
    folder = prepare(path)
    try:
        yield folder
    except BaseException:
        for one in made:
            # What holds something stays, and what it is in.
            with contextlib.suppress(OSError):
                one.rmdir()
        raise


def write(folder: Path, path: Path) -> list[Path]:
    """Write the leaderboard of the results in `folder` to `path`, and its `scores_file` beside it.

    Raises:
        FileNotFoundError: If `folder` holds no results.
        ValueError: If they are broken.
    """
    known = tables.read(folder)
    path.parent.mkdir(parents=True, exist_ok=True)
    table = scores.cells(known).round(tables.DECIMALS).to_csv(index=False, lineterminator="\n")
    written = {
        path: markdown(
            known,
            held_out.read(folder),
            studies.read(folder),
            tuning.read(folder),
            captions.links(known, folder, files(path).name),
            additions.unverified(folder),
            scores_table=scores_file(path).name,
        ),
        scores_file(path): table,
    }
    for name, content in written.items():
        with atomic_file(name) as file:
            file.write(content.encode())
    return list(written)


def markdown(
    known: Results,
    tested: pd.DataFrame | None = None,
    studied: pd.DataFrame | None = None,
    searched: pd.DataFrame | None = None,
    figures: Mapping[str, Sequence[str]] = MappingProxyType({}),
    unverified: Collection[str] = (),
    changed: Collection[str] = (),
    scores_table: str = SCORES,
) -> str:
    """Return the leaderboard as Markdown.

    The others are what `held_out`, `studies` and `tuning` read, None where there is nothing; `figures` are
    links to the pictures of each part of `scores.parts`, `unverified` names of trials: rows that hold one say
    so. `changed` are names of trials with another environment than their task's,
    `scores_table` is the name of the `scores_file`. The pictures of the first
    part stand at the top, those of each other part in its own section.
    """
    doubted = set(unverified) & set(known.trials["trial"])
    reading = text.folded("How to read the numbers", f"{READING}\n{MEASURES.format(scores=scores_table)}")
    first, *others = scores.parts(known)
    parts = [TITLE, *verdict.sentences(known, tested), *figures.get(first, ()), reading]
    pictures = {name: figures.get(name, ()) for name in others}
    for name, own in scores.parts(known).items():
        pairs = ranking.improvement(scores.learners(own))
        parts += together.sections(own, name, pairs, doubted, pictures.get(name, ()))
    rows = scores.cells(known)
    for name, own in further.split(known).items():
        where = "" if name == further.GRID else f": {name}"
        parts += _cells(own, rows[rows["table"] == name], where, doubted)
    never_seen = _never_seen(known, tested)
    made = {
        "usbench transfer": never_seen,
        "": _people(studied),
        "usbench leaderboard --search search": _tuning(searched),
    }
    parts += [part for section in made.values() for part in section]
    commands = [command for command, section in made.items() if command and section]
    parts += ["## How this was made", provenance.making(known.trials, commands, changed)]
    if notes := _notes(known, tested if never_seen else None):
        listed = "\n".join(f"* {note}" for note in notes)
        parts += ["## Notes", text.folded(f"Notes ({len(notes)})", listed)]
    if doubted:
        parts.append(additions.meaning(doubted))
    return "\n\n".join(parts) + "\n"


def _never_seen(known: Results, tested: pd.DataFrame | None) -> list[str]:
    """Return the section of what agents of the grid reach on unseen phantoms."""
    found = pd.DataFrame() if tested is None else held_out.table(further.first(known), tested)
    return [] if found.empty else ["## Unseen phantoms", held_out.section(found)]


def _people(studied: pd.DataFrame | None) -> list[str]:
    """Return the section of what people reached with a guide."""
    if studied is None or studied.empty:
        return []
    return ["## People", studies.READING, text.table(studies.HEAD, studies.texts(studied), words=4)]


def _tuning(searched: pd.DataFrame | None) -> list[str]:
    """Return the section of what the candidates of a search reached."""
    if searched is None or searched.empty:
        return []
    n_rows = text.rows(len(tuning.candidates(searched)))
    folded = text.folded(f"Scores of candidates ({n_rows})", tuning.section(searched))
    return ["## How hard each is to tune", tuning.ABOUT, folded]


def _notes(known: Results, tested: pd.DataFrame | None) -> list[str]:
    """Return what has to be said of trials and of rows that are not in a table, each once."""
    notes = [
        f"{text.code(agent)} has no row that covers {name}: {why}."
        for name, own in scores.parts(known).items()
        for agent, why in sorted(scores.matrices(own)[1].items())
    ]
    for name, own in further.split(known).items():
        in_table = "" if name == further.GRID else f"In {name}: "
        notes += [f"{in_table}{note}" for note in provenance.notes(own.trials)]
    notes += provenance.origins(known.trials)
    if tested is not None:
        missing = held_out.not_tested(further.first(known), tested)
        notes += [f"Agents of {cell.name} were not tested on unseen phantoms." for cell in missing]
    return notes


def _cells(own: Results, rows: pd.DataFrame, where: str, doubted: set[str]) -> list[str]:
    """Return the sections of a table's cells."""
    settings = dict(own.trials[["configuration", "settings"]].itertuples(index=False, name=None))
    trials_of = dict(iter(own.trials.groupby(CELL)))
    parts = []
    for cell, own_rows in rows.groupby(CELL):
        doubtful = additions.holders(own.trials, doubted & set(trials_of[cell]["trial"]))
        heading = f"## {Cell(*cell).name}{where}"
        parts += [heading, _anchors(trials_of[cell]), _cell(own_rows, settings, doubtful)]
    return parts


def _anchors(trials: pd.DataFrame) -> str:
    """Return the exact returns of a cell in a sentence."""
    known = trials.dropna(subset=["optimal", "random", "stay"])
    if known.empty:
        return "No trial has begun."
    # As precise as is shown: where frames are rewards, another kind of processor changes the fifth digit.
    if len(known[["optimal", "random", "stay"]].round(2).drop_duplicates()) > 1:
        return "The trials are from different environments: each has exact returns of its own."
    anchors = Anchors(**known.iloc[0][["optimal", "random", "stay"]])
    return (
        f"Exact returns: optimum {text.number(anchors.optimal, 2)} (score 1), random agent "
        f"{text.number(anchors.random, 2)} (score 0), idle agent {text.number(anchors.stay, 2)} "
        f"(score {text.number(anchors.score(anchors.stay), 2)})."
    )


def _cell(rows: pd.DataFrame, settings: Mapping[str, str], doubtful: Collection[str]) -> str:
    """Return the table of one task and noise: those that are ranked first, then the others, best first.

    `settings` are those of each configuration, `doubtful` the agents that hold a trial that is not verified.
    """
    sampled = rows[rows["actions"] == SAMPLED].set_index(ROW)
    table = rows[rows["actions"] == SCORED]
    notes = [scores.note(*one) for one in zip(table["algo"], table["steps"], strict=True)]
    table = table.assign(note=notes, beside=[note != "" for note in notes])
    table = table.sort_values(["beside", "score", "agent"], ascending=[True, False, True], kind="stable")
    differing = (rows["table"] == unseen.NAME).any()
    measures = (SUCCESS,) if differing else (RETURN, SUCCESS)
    lines = []
    for row in table.to_dict("records"):
        other = sampled.loc[tuple(row[name] for name in ROW)]
        lines.append(
            [
                text.agent(row["agent"], row["note"], additions.MARK if row["agent"] in doubtful else ""),
                f"{row['seeds']}/{row['seeds_asked']}",
                text.interval(row["score"], row["score_low"], row["score_high"]),
                *([] if differing else [text.interval(*other[["score", "score_low", "score_high"]])]),
                *(
                    DASH if name in row_of(row["task"]).silent else text.number(scale * row[name], digits)
                    for _, name, scale, digits in measures
                ),
                *(unseen.columns(row, settings) if differing else ()),
            ]
        )
    titles = [title for title, *_ in measures]
    more = [*titles, *unseen.COLUMNS] if differing else ["score, sampled", *titles]
    shown = text.table(["agent", "seeds", "score, greedy", *more], lines)
    return text.folded(f"Scores ({text.rows(len(lines))})", shown)
