"""Tables of the page that the leaderboard lacks: how episodes end, settings, what became of every trial."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from usbench import suite
from usbench.figures import episode_ends
from usbench.records import Trial
from usbench.results import scores, studies
from usbench.results.agents import named
from usbench.results.tables import Results
from usbench.results.text import DASH, number

# Columns of `episode_ends.shares` and what they mean.
ENDINGS = {
    "success": "at the goal",
    "beside": "beside the object",
    "too_deep": "focus too deep",
    "too_shallow": "focus too shallow",
    "out_of_plane": "out of the object's plane",
    "long_way": "in plane, by the long way",
}


@dataclass(frozen=True)
class Table:
    """A table: `caption` is a line of Markdown; `words` tells how many first columns are not numbers."""

    caption: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    words: int = 1


def studied(runs: Path) -> Table | None:
    """Return how people did, alone and with advice, beside agent and optimum; None if there is no study."""
    known = studies.gather(runs)
    return None if known.empty else Table(studies.READING, studies.HEAD, studies.texts(known), words=4)


def endings(runs: Path, known: Results) -> list[Table]:
    """Return how the episodes of finished trials end, a table for each task."""
    finished = known.trials.loc[known.trials["status"] == "finished", "trial"]
    if finished.empty:
        return []
    agents = named(known.trials).set_index("trial")["agent"]
    ends = [_last(Trial.read(runs / name), agents[name]) for name in finished]
    shares = episode_ends.shares(pd.concat(ends))
    tables = []
    for task, rows in shares.groupby("task"):
        kinds = [kind for kind in ENDINGS if rows[kind].notna().any()]
        tables.append(
            Table(
                f"{suite.TASKS[task].guidance.title}: how episodes end (% of episodes; one may be in several "
                "columns)",
                ["agent", "noise", "seeds", *(ENDINGS[kind] for kind in kinds)],
                [
                    [
                        row["algo"],
                        f"{row['noise']:g}",
                        str(row["seeds"]),
                        *(number(100 * row[kind], 0) for kind in kinds),
                    ]
                    for row in rows.to_dict("records")
                ],
            )
        )
    return tables


def _last(trial: Trial, agent: str) -> pd.DataFrame:
    """Return the last evaluation with the columns that `episode_ends.shares` needs of a trial."""
    config = trial.config
    of_trial = {"trial": trial.name, "task": config.task, "noise": config.noise, "seed": config.seed}
    return trial.last_evaluation(deterministic=True).assign(**of_trial, algo=agent)


def settings(known: Results) -> Table:
    """Return the hyperparameters of every agent that learns."""
    learning = named(known.trials[known.trials["steps"] > 0])
    rows = [
        [agent, ", ".join(sorted(set(own["task"]))), str(steps), _words(json.loads(text))]
        for (agent, steps, text), own in learning.groupby(["agent", "steps", "settings"])
    ]
    return Table(
        "Agents: training steps and hyperparameters", ["agent", "task", "steps", "settings"], rows, 4
    )


def environments(runs: Path, known: Results) -> list[Table]:
    """Return phantom, probe and imaging, a table for each configuration of the environment."""
    tables = []
    for (task, _), own in known.trials.groupby(["task", scores.environments(known.trials)]):
        values = dict(Trial.read(runs / own["trial"].iloc[0]).config.environment)
        # What agents are told stands with their settings, since agents of one environment differ in it.
        values.pop("senses", None)
        title = (
            f"{suite.TASKS[str(task)].guidance.title}: environment (SI units unless a name ends with another)"
        )
        rows = [[name, _value(value)] for name, value in _flat(values)]
        tables.append(Table(title, ["setting", "value"], rows, 2))
    return tables


def trials(known: Results) -> Table:
    """Return what became of every trial."""
    last = scores.last(known)
    final = dict(zip(last["trial"], last["normalized_score"], strict=True))
    rows = [
        [
            row["trial"],
            row["status"] + (f": {' '.join(row['reason'].split())}" if row["reason"] else ""),
            row["frames"] or DASH,
            number(final[row["trial"]], 3) if row["trial"] in final else DASH,
            DASH if pd.isna(row["training_s"]) else f"{row['training_s'] / 60:.1f}",
        ]
        for row in known.trials.to_dict("records")
    ]
    head = ["trial", "status", "frames (digest)", "score", "training (min)"]
    return Table("Every trial: greedy score after the last step, time", head, rows, 3)


def _words(values: Mapping[str, Any]) -> str:
    return ", ".join(f"{key} {_value(value)}" for key, value in values.items() if key != "environment")


def _value(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def _flat(values: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in values.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{above}{key} ")
        else:
            yield f"{above}{key}", value
