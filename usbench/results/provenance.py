"""How results were made, from the rows of trials: command, versions, time, and what a reader has to know."""

from collections import defaultdict
from collections.abc import Collection, Sequence

import pandas as pd

from usbench import seed_pools
from usbench.results.agents import changed_hyperparameters, is_usual, named, spelled
from usbench.results.protocol import further, unseen
from usbench.results.scores import CELL, Cell, environments
from usbench.results.text import code, escaped, exact, in_lines, listed
from usbench.tasks import row_of
from usbench.words import network_apart

NAMED = 3
OTHER = "other settings"
FRAMES = (
    "Frames differ with the simulator's version and, in tens of pixels in a million by one grey level, with "
    "the kind of processor (`benchmarks/processors.py`)."
)
STATUS_WORDS = {
    "missing": "has not been run",
    "running": "is running or was killed",
    "interrupted": "was interrupted",
    "failed": "failed",
}


def making(trials: pd.DataFrame, besides: Sequence[str] = (), changed: Collection[str] = ()) -> str:
    """Return the commands, how many trials are finished, the hours and the versions, as Markdown.

    The commands `besides` make what is on the page beside the trials. Trials with the names `changed` have
    another environment than their task's, which no command of these says: they are named.
    """
    finished = trials[trials["status"] == "finished"]
    as_named = trials[~trials["trial"].isin(changed)]
    lines = [line for name, own in further.tables_of(as_named).items() for line in _commands_of(name, own)]
    if len(lines) > 1:
        lines.append("usbench leaderboard --runs runs")
    lines += besides if lines else []
    parts = ["\n".join(["```", *map(in_lines, lines), "```"])] if lines else []
    if others := sorted(set(changed) & set(trials["trial"])):
        parts.append(
            f"No command here makes trials whose environment is not their task's: {len(others)} of "
            f"{len(trials)}, as {code(others[0])}."
        )
    parts.append(
        f"{len(finished)} of {len(trials)} trials are finished. One after another they took "
        f"{_time(finished['total_s'].sum(), finished['training_s'].sum())} of them training."
    )
    if not finished.empty:
        parts.append(f"Versions: {finished['versions'].mode().iloc[0] or 'not recorded'}.")
    return "\n\n".join(parts)


def _time(total_s: float, training_s: float) -> str:
    """Return both times in words, in minutes where all is less than an hour."""
    if total_s < 3600:
        return f"{total_s / 60:.1f} minutes on one core, {training_s / 60:.1f}"
    return f"{total_s / 3600:.2f} hours on one core, {training_s / 3600:.2f}"


def _commands_of(name: str, own: pd.DataFrame) -> list[str]:
    """Return the commands that make the trials of a table."""
    if name == further.GRID:
        return [*commands(own), *unseen.commands(_left(own))]
    if name == unseen.NAME or not _as_planned(name, own):
        return unseen.commands(own)
    return [f"usbench compare --table {name}"]


def _as_planned(name: str, own: pd.DataFrame) -> bool:
    """Return whether a comparison of a further table makes all of these trials, and perhaps more."""
    first = seed_pools.own().comparison.first
    learned = named(own[own["steps"] > 0])
    seeds = range(first, first + further.n_seeds(name))
    rows = seed_pools.protocol()["comparison"]["rows"]
    return all(
        trial["seed"] in seeds
        and network_apart(trial["algo"])[0] in rows
        and trial["agent"] == trial["algo"]
        and not changed_hyperparameters(trial)
        for _, trial in learned.iterrows()
    )


def commands(trials: pd.DataFrame) -> list[str]:
    """Return the comparisons that make these trials.

    An algorithm on a task is left out where no comparison makes its trials: they are other seeds than the
    first ones of the comparison's pool, have holes, or settings that are not those of the algorithm's row.
    Agents that do not learn are in every comparison without being named.
    """
    tasks_of: dict[tuple[str, str], list[str]] = defaultdict(list)
    for (algo, task), own in _rows(trials).groupby(["algo", "task"]):
        if options := _options(str(task), own):
            tasks_of[str(algo), options].append(str(task))
    algos_of: dict[tuple[str, str], list[str]] = defaultdict(list)
    for (algo, options), tasks in tasks_of.items():
        algos_of[" ".join(tasks), options].append(algo)
    return [
        f"usbench compare --algos {' '.join(algos)} --tasks {tasks} {options}"
        for (tasks, options), algos in algos_of.items()
    ]


def _left(trials: pd.DataFrame) -> pd.DataFrame:
    """Return the trials that none of the comparisons in `commands` makes."""
    rows = _rows(trials).groupby(["algo", "task"])
    made = [index for (_, task), own in rows if _options(str(task), own) for index in own.index]
    return trials.drop(made)


def _rows(trials: pd.DataFrame) -> pd.DataFrame:
    """Return the trials that learned and are in the row of their algorithm, with its settings of today."""
    own = named(trials)
    own = own[(own["steps"] > 0) & (own["agent"] == own["algo"])]
    return own[pd.Series((is_usual(one) for _, one in own.iterrows()), index=own.index, dtype=bool)]


def _options(task: str, own: pd.DataFrame) -> str:
    """Return the options of the comparison that makes an algorithm's trials on a task, "" if none does."""
    seeds, noises, steps = (sorted(set(own[name])) for name in ("seed", "noise", "steps"))
    first = seed_pools.own().comparison.first
    whole = seeds == list(range(first, first + len(seeds)))
    if not whole or len(steps) > 1 or len(own) != len(seeds) * len(noises):
        return ""
    options = f"--noise {' '.join(map(exact, noises))} --seeds {len(seeds)}"
    return options if steps == [row_of(task).steps] else f"{options} --steps {steps[0]}"


def notes(trials: pd.DataFrame) -> list[str]:
    """Return a sentence for everything that makes rows of a table differ from what they seem to be."""
    return [
        *_unfinished(trials),
        *_configurations(trials),
        *_other_settings(trials),
        *_environments(trials),
        *_budgets(trials),
        *_seeds(trials),
        *_pools(trials),
    ]


def origins(trials: pd.DataFrame) -> list[str]:
    """Return a sentence for each version and each task's frames that differ between trials, of all tables."""
    finished = trials[trials["status"] == "finished"]
    return [*_versions(finished), *_frames(finished)]


def _unfinished(trials: pd.DataFrame) -> list[str]:
    found = []
    for (*cell, algo), rows in trials[trials["status"] != "finished"].groupby([*CELL, "algo"]):
        seeds = [
            f"seed {row.seed} {STATUS_WORDS[row.status]}"
            + (f" ({escaped(' '.join(row.reason.split()))})" if row.reason else "")
            for row in rows.itertuples()
        ]
        found.append(f"{code(algo)} on {Cell(*cell).name}: {', '.join(seeds)}.")
    return found


def _configurations(trials: pd.DataFrame) -> list[str]:
    """Tell apart the configurations of one cell by the settings in which they differ."""
    found = []
    for (*cell, algo), rows in named(trials).groupby([*CELL, "algo"]):
        variants = rows.drop_duplicates("configuration").set_index("agent")
        if len(variants) == 1:
            continue
        settings = pd.DataFrame(
            [spelled(row.settings, row.steps) for row in variants.itertuples()], index=variants.index
        ).astype(str)
        differing = settings.loc[:, settings.nunique() > 1]
        each = [
            f"{code(name)} has {listed(f'{key}={value}' for key, value in row.items()) or OTHER}"
            for name, row in differing.iterrows()
        ]
        found.append(
            f"{code(algo)} on {Cell(*cell).name} ran in {len(variants)} configurations, each in a row "
            f"of its own: {'; '.join(each)}."
        )
    return found


def _other_settings(trials: pd.DataFrame) -> list[str]:
    """Tell what rows have otherwise than the table of algorithms, where their names do not say all of it."""
    found: dict[tuple[str, str], dict[str, None]] = defaultdict(dict)
    for _, trial in named(trials).drop_duplicates("configuration").iterrows():
        recorded = changed_hyperparameters(trial).items()
        changed = [f"{key}={value}" for key, value in recorded if value is not None]
        said = trial["agent"].removeprefix(trial["algo"]).strip().split(", ")
        if not {*changed} <= {*said}:
            found[trial["agent"], network_apart(trial["algo"])[0]][listed(changed)] = None
    return [
        f"{code(agent)} has other settings than `usbench list {algo}` shows: {'; or '.join(each)}."
        for (agent, algo), each in sorted(found.items())
    ]


def _budgets(trials: pd.DataFrame) -> list[str]:
    found = []
    for task, own in named(trials[trials["steps"] > 0]).groupby("task"):
        budgets = own.groupby("steps")["agent"].unique()
        if len(budgets) > 1:
            each = [f"{steps} steps for {listed(sorted(algos))}" for steps, algos in budgets.items()]
            found.append(f"Training budgets on {task} differ: {'; '.join(each)}.")
    return found


def _environments(trials: pd.DataFrame) -> list[str]:
    found = []
    for cell, own in trials.assign(environment=environments(trials)).groupby(CELL):
        agents = own.groupby("environment")["algo"].unique()
        if len(agents) > 1:
            each = [f"{listed(sorted(algos))} in {digest}" for digest, algos in agents.items()]
            found.append(
                f"Trials on {Cell(*cell).name} are from different environments (their digests): "
                f"{'; '.join(each)}. Their scores cannot be compared."
            )
    return found


def _seeds(trials: pd.DataFrame) -> list[str]:
    cells = defaultdict(list)
    for cell, rows in named(trials[trials["steps"] > 0]).groupby(CELL):
        agents = defaultdict(list)
        for agent, seeds in rows.groupby("agent")["seed"]:
            agents[" ".join(map(str, sorted(set(seeds))))].append(agent)
        if len(agents) > 1:
            each = [f"{seeds} for {listed(names)}" for seeds, names in sorted(agents.items())]
            cells["; ".join(each)].append(Cell(*cell).name)
    return [f"Seeds differ on {' / '.join(names)}: {each}." for each, names in cells.items()]


def _pools(trials: pd.DataFrame) -> list[str]:
    pool = seed_pools.own().comparison
    others = sorted({seed for seed in trials.loc[trials["steps"] > 0, "seed"] if seed not in pool})
    if not others:
        return []
    return [
        f"These seeds are not kept for comparisons, as {pool} are, so that settings may have been chosen on "
        f"them: {', '.join(map(str, others))}."
    ]


def _versions(finished: pd.DataFrame) -> list[str]:
    if finished["versions"].nunique() < 2:
        return []
    packages = [
        {name: number for name, _, number in (item.partition(" ") for item in versions.split(", "))}
        for versions in finished["versions"]
    ]
    table = pd.DataFrame(packages, index=finished["trial"]).fillna("not recorded")
    table = table.drop(columns="", errors="ignore")
    return [
        f"Versions of {name} differ between trials: {_counted(table[name])}."
        for name in sorted(table)
        if table[name].nunique() > 1
    ]


def _frames(finished: pd.DataFrame) -> list[str]:
    found = []
    for (task, _), rows in finished.groupby(["task", environments(finished)]):
        # Reference policies look at none, and record none since they need not be simulated for them.
        looked = rows[(rows["steps"] > 0) | (rows["frames"] != "")]
        frames = looked.set_index("trial")["frames"].replace("", "not recorded")
        if frames.nunique() > 1:
            kinds = " + ".join(str(len(own)) for _, own in _groups(frames))
            found.append(
                f"Frames of {task} differ between trials: {frames.nunique()} kinds, in {kinds} trials "
                "(`frames` in `trials.csv`)."
            )
    if found:
        found.append(FRAMES)
    return found


def _counted(values: pd.Series) -> str:
    """Return each value with its number of trials, the most common first; rarer ones name their trials."""
    groups = _groups(values)
    texts = [f"{groups[0][0]} in {len(groups[0][1])}"]
    for value, trials in groups[1:]:
        names = [code(str(name)) for name in trials.index[:NAMED]] + ["..."] * (len(trials) > NAMED)
        texts.append(f"{value} in {len(trials)} ({', '.join(names)})")
    return ", ".join(texts)


def _groups(values: pd.Series) -> list[tuple[str, pd.Series]]:
    """Return each value with its trials, the most common first."""
    return sorted(values.groupby(values), key=lambda group: (-len(group[1]), group[0]))
