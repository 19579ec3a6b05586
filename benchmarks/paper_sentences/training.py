"""Sentences on training: what rises and falls, what noise does to that, and what is learned in the end."""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from paper_sentences.sentence import Sentence, of_intervals, verdict_of
from usbench.results import scores, stats
from usbench.results.scores import Cell
from usbench.results.stats import Array, Interval
from usbench.results.tables import GREEDY, TRAINING, TRAINING_PARTS, Results
from usbench.results.text import DASH, interval, table

# A tenth of training, in its parts.
TENTH = TRAINING_PARTS // 10


def changes(known: Results) -> list[Sentence]:
    """Return the sentences on what changes while the agent learns."""
    tenths = (
        "In every trial, the mean over training episodes of the last tenth of training is {} than that of "
        "the first."
    )
    return [
        trend(
            known,
            "return",
            True,
            "For both tasks, the return increased with the number of policy update iterations",
            tenths.format("larger"),
            ("fp", "pp"),
        ),
        trend(
            known,
            "final_distance_mm",
            False,
            "The average distances … for the PP task … decreased with time",
            tenths.format("smaller") + " Final distance in mm, Figure 5 (a).",
            ("pp",),
        ),
        trend(
            known,
            "abs_sin_angle",
            False,
            "… and scanning plane … decreased with time",
            tenths.format("smaller") + " Sine of the final angle between the planes, Figure 5 (b).",
            ("pp",),
        ),
        noise(known),
    ]


def trend(known: Results, column: str, up: bool, words: str, rule: str, tasks: tuple[str, ...]) -> Sentence:
    """Return a sentence on what rises or falls in training, by task and noise."""
    each = change(known, column)
    each = each[each["task"].isin(tasks)]
    true = (each["last"] > each["first"]) == up
    rows = [
        [
            Cell(*cell).name,
            f"{own['first'].mean():.2f}",
            f"{own['last'].mean():.2f}",
            f"{int(true[own.index].sum())} of {len(own)}",
        ]
        for cell, own in each.groupby(scores.CELL)
    ]
    head = ["cell", "first tenth", "last tenth", "trials of which it is true"]
    return Sentence(words, rule, verdict_of(int(true.sum()), len(each)), table(head, rows))


def noise(known: Results) -> Sentence:
    """Return the sentence on what noise does to a learning curve."""
    each = change(known, "return")
    rises = (each["last"] - each["first"]).groupby([each["task"], each["noise"]])
    rise = rises.mean().unstack()
    share = rise.div(rise[0.0], axis=0)
    most = max(share.dropna(axis=1))  # of the noises with which both tasks are trained
    of_cell = {cell: own.to_numpy() for cell, own in rises}
    fp, pp, more = lost({task: (of_cell[task, 0.0], of_cell[task, most]) for task in ("fp", "pp")})
    said = [interval(100 * one.estimate, 100 * one.low, 100 * one.high, 0) for one in (fp, pp, more)]
    rows = [
        [
            f"`{task}`",
            *(
                DASH if pd.isna(own) else f"{own:.2f} ({100 * share.loc[task, p]:.0f} %)"
                for p, own in rise.loc[task].items()
            ),
        ]
        for task in rise.index
    ]
    return Sentence(
        "Increasing the likelihood of noise impacts the trend of a learning curve, especially for the PP "
        "task",
        "The rise of the return of training episodes, from the first to the last tenth, is smaller with "
        f"most noise (here {most:g}) than without on `fp` and on `pp`, and `pp` loses more. Each of these "
        "three has to have a 95 % interval above 0; where an interval holds 0, it cannot be told.",
        of_intervals((fp, pp, more)),
        f"Of the rise without noise, {said[0]} % are lost on `fp` and {said[1]} % on `pp`; the difference, "
        f"`pp` less `fp`, is {said[2]} percentage points (seeds resampled within each cell).\n\n"
        + table(["task", *(f"rise at noise {p:g}" for p in rise.columns)], rows),
    )


def learned(known: Results) -> Sentence:
    """Return the sentence on what the agent can do after the training."""
    rows, better, finals = [], [], []
    for cell, own in known.trials.groupby(scores.CELL):
        curves = known.curves[known.curves["trial"].isin(own["trial"]) & (known.curves["kind"] == GREEDY)]
        groups = curves.sort_values("step").groupby("trial")
        # In the order of seeds, as the leaderboard has them: the same resamples.
        before, after = groups.head(1), groups.tail(1).sort_values("trial")
        finals.append(after["normalized_score"].to_numpy(float))
        score = scores.score_of(finals[-1][:, np.newaxis])
        better.append(after["success_rate"].mean() > before["success_rate"].mean())
        rows.append(
            [
                Cell(*cell).name,
                interval(score["score"], score["score_low"], score["score_high"], 2),
                f"{100 * before['success_rate'].mean():.0f}",
                f"{100 * after['success_rate'].mean():.0f}",
            ]
        )
    # Seeds are drawn for each cell by themselves, so that their order does not matter.
    score = scores.score_of(np.column_stack(finals))
    all_cells = interval(score["score"], score["score_low"], score["score_high"], 2)
    rows.append(["all cells together", all_cells, DASH, DASH])
    head = ["cell", "score after", "success before (%)", "success after (%)"]
    return Sentence(
        "After the training, the agent's ability to accurately locate the position of the focal depth and "
        "scanning plane improved",
        "More evaluation episodes end at the goal after training than before it, with greedy actions, in "
        "every cell.",
        verdict_of(sum(better), len(better)),
        table(head, rows),
    )


def lost(rises: Mapping[str, tuple[Array, Array]]) -> tuple[Interval, Interval, Interval]:
    """Return the share of the rise that noise takes on `fp` and on `pp`, and how much more it is on `pp`.

    `rises` are those of each task's trials, without noise and with it.
    """
    generator = np.random.default_rng(stats.BOOTSTRAP_SEED)
    found, drawn = {}, {}
    for task, own in rises.items():
        quiet, noisy = (one[generator.integers(len(one), size=(stats.N_RESAMPLES, len(one)))] for one in own)
        found[task] = np.asarray(1 - own[1].mean() / own[0].mean())
        drawn[task] = 1 - noisy.mean(axis=1) / quiet.mean(axis=1)
    return (
        stats.percentiles(found["fp"], drawn["fp"]),
        stats.percentiles(found["pp"], drawn["pp"]),
        stats.percentiles(found["pp"] - found["fp"], drawn["pp"] - drawn["fp"]),
    )


def change(known: Results, column: str) -> pd.DataFrame:
    """Return the means of training episodes in the `first` and the `last` tenth, a row per trial."""
    rows = known.curves[known.curves["kind"] == TRAINING].sort_values("step")
    ends = rows.groupby("trial")[column]
    found = pd.DataFrame(
        {
            "first": ends.apply(lambda own: own.head(TENTH).mean()),
            "last": ends.apply(lambda own: own.tail(TENTH).mean()),
        }
    )
    return known.trials.merge(found, on="trial")
