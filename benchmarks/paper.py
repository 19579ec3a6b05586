"""The paper's results sentence by sentence beside ours: `make paper` writes docs/paper.md and its figures.

All numbers are from the committed tables, and whether a sentence holds follows from them by the rule that
stands beside it.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from usbench.figures import paper, style
from usbench.results import held_out, scores, stats, tables, verdict
from usbench.results.agents import named
from usbench.results.scores import Cell
from usbench.results.stats import Array, Interval
from usbench.results.tables import GREEDY, TRAINING, TRAINING_PARTS, Results
from usbench.results.text import DASH, interval, table

TOP = Path(__file__).parents[1]
COMMITTED, PAGE = TOP / "leaderboard_files", TOP / "docs" / "paper.md"
# How episodes end, as benchmarks/failures.py keeps it.
ENDS = TOP / "docs" / "ends.csv"
AGENT = verdict.PAPERS_OWN
# A tenth of training, in its parts.
TENTH = TRAINING_PARTS // 10
HOLDS, FAILS, PARTLY, OPEN = "holds", "does not hold", "holds in part", "cannot be told"
# Of all episodes, those that are "sometimes": one alone is not.
SOMETIMES = 0.01


ABOUT = """\
This page is written by `make paper` from the tables of the [leaderboard](../leaderboard.md) and of [how
episodes end](failures.md); it is not edited by hand. Each sentence of the paper's results, and of
what its abstract says of them, stands beside what `{agent}` does here: the paper's algorithm with its
Table II, {n_seeds} seeds in each cell ({seeds}; the paper has 4), {steps} training steps. Whether a
sentence holds follows from the numbers, by the rule that stands with it. The agent here sees 4 frames at a
time, that of the paper saw 1, and the simulator is another one: shapes and signs can be compared, heights
cannot."""
OTHERS = "It would certainly be worth to evaluate the performance of other reinforcement learning methods"
FIGURES = """\
The figures are Figures 4 and 5 of the paper, with its axes: means over seeds, bars of one standard
deviation, and policy updates of 64 steps on the upper axis. The third panel of Figure 5 is not in the
paper. The paper's own curves are not drawn beside ours: this repository has neither their
numbers nor its pictures, and heights could not be compared.

![Figure 4: return of training episodes on both tasks](paper_figure4.png)

![Figure 5: final distance and sine of the final angle](paper_figure5.png)"""


@dataclass(frozen=True)
class Sentence:
    """A sentence of the paper, whether it holds here, by which rule, and the numbers."""

    words: str
    rule: str
    holds: str
    numbers: str

    def markdown(self) -> str:
        """Return its section."""
        rule = f"{self.rule[0].lower()}{self.rule[1:]}"
        return f"## “{self.words}”\n\n**{self.holds.capitalize()}.** The rule: {rule}\n\n{self.numbers}"


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


def verdict_of(n_true: int, n_all: int) -> str:
    """Return whether a sentence holds that is true of so many trials."""
    return HOLDS if n_true == n_all else FAILS if n_true == 0 else PARTLY


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
        f"most noise (here {most:g}) than without on both tasks, and loses more on `pp`. Each of these three "
        "is decided only if its 95 % interval leaves out 0; otherwise it cannot be told.",
        of_intervals((fp, pp, more)),
        f"Of the rise without noise, {said[0]} % are lost on `fp` and {said[1]} % on `pp`; the difference, "
        f"`pp` less `fp`, is {said[2]} percentage points (seeds resampled within each cell).\n\n"
        + table(["task", *(f"rise at noise {p:g}" for p in rise.columns)], rows),
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


def of_intervals(differences: Sequence[Interval]) -> str:
    """Return whether a sentence holds that says of differences that each is above 0."""
    each = {HOLDS if one.low > 0 else FAILS if one.high < 0 else OPEN for one in differences}
    return each.pop() if len(each) == 1 else OPEN if OPEN in each else PARTLY


def sometimes(known: Results, ends: pd.DataFrame, kind: str) -> tuple[str, str]:
    """Return how many episodes of `known` in the cells of `ends` end so, and whether that is sometimes."""
    last = known.curves[known.curves["kind"] == GREEDY].sort_values("step").groupby("trial").tail(1)
    n_episodes = known.trials.merge(last, on="trial").groupby(scores.CELL)["episodes"].sum()
    counted = ends.set_index(scores.CELL)[kind]
    n_all = n_episodes.loc[counted.index]
    found = int((counted * n_all).round().sum())
    holds = HOLDS if found >= SOMETIMES * n_all.sum() else FAILS
    absent = [
        Cell(*cell).name for cell in n_episodes.index.difference(n_all.index) if cell[0] in set(ends["task"])
    ]
    apart = f" The single episodes of {', '.join(absent)} are not kept." if absent else ""
    return f"{found} of {n_all.sum()} episodes end so.{apart}", holds


def endings(known: Results, ends: pd.DataFrame) -> tuple[Sentence, Sentence]:
    """Return the two sentences on single episodes, from the shares that `episode_ends.shares` tells.

    Raises:
        ValueError: If the shares are not those of the trials of `known`.
    """
    own = ends[ends["algo"] == AGENT]
    _check_seeds(known, own)
    depth, plane = own[own["task"] == "fp"], own[own["task"] == "pp"]
    too_deep, misses = sometimes(known, depth, "too_deep")
    long_way, turns = sometimes(known, plane, "long_way")
    least = f"At least {100 * SOMETIMES:g} % of the episodes"
    return (
        Sentence(
            "In the FP task, the agent sometimes misses the target depth when moving the focal point from "
            "the top to the bottom",
            f"{least} end with the focus below the target, all of them having begun above it.",
            misses,
            f"{too_deep} "
            + episodes(depth, {"too deep (%)": depth["too_deep"], "too shallow (%)": depth["too_shallow"]}),
        ),
        Sentence(
            "In the PP task, the agent sometimes rotates the probe in a non-optimal direction (but still "
            "achieves the appropriate plane, due to the symmetry of the object)",
            f"{least} end in the object's plane after a rotation by more than a right angle. At half a turn "
            "from the object's angle it looks the same.",
            turns,
            f"{long_way} "
            + episodes(
                plane,
                {
                    "turn the long way (%)": plane["long_way"],
                    "end in plane (%)": 1 - plane["out_of_plane"],
                    "end at half a turn (%)": plane["half_turn"],
                },
            ),
        ),
    )


def _check_seeds(known: Results, ends: pd.DataFrame) -> None:
    """Raise ValueError unless each row of `ends` is of as many trials as `known` has in its cell."""
    n_trials = known.trials.groupby(scores.CELL).size()
    for row in ends.itertuples():
        n_known = n_trials.get((row.task, row.noise), 0)
        if row.seeds != n_known:
            raise ValueError(
                f"the row of {row.algo} on {Cell(row.task, row.noise).name} in {ENDS.name} is of {row.seeds} "
                f"trials, and must be of all {n_known} of the leaderboard."
            )


def episodes(ends: pd.DataFrame, shares: Mapping[str, pd.Series]) -> str:
    """Return a table of the shares of episodes, a row per cell of `ends`."""
    rows = [
        [
            Cell(row.task, row.noise).name,
            str(row.seeds),
            *(f"{100 * share[row.Index]:.1f}" for share in shares.values()),
        ]
        for row in ends.itertuples()
    ]
    about = "Evaluation episodes after training, greedy actions ([how episodes end](failures.md))."
    return f"{about}\n\n{table(['cell', 'trials', *shares], rows)}"


def learned(known: Results) -> Sentence:
    """Return the sentence on what the agent can do after the training."""
    rows, better = [], []
    for cell, own in known.trials.groupby(scores.CELL):
        curves = known.curves[known.curves["trial"].isin(own["trial"]) & (known.curves["kind"] == GREEDY)]
        groups = curves.sort_values("step").groupby("trial")
        before, after = groups.head(1), groups.tail(1)
        score = scores.score_of(after[["normalized_score"]].to_numpy(float))
        better.append(after["success_rate"].mean() > before["success_rate"].mean())
        rows.append(
            [
                Cell(*cell).name,
                interval(score["score"], score["score_low"], score["score_high"], 2),
                f"{100 * before['success_rate'].mean():.0f}",
                f"{100 * after['success_rate'].mean():.0f}",
            ]
        )
    head = ["cell", "score after", "success before (%)", "success after (%)"]
    return Sentence(
        "After the training, the agent's ability to accurately locate the position of the focal depth and "
        "scanning plane improved",
        "More evaluation episodes end at the goal after training than before it, with greedy actions, in "
        "every cell.",
        verdict_of(sum(better), len(better)),
        table(head, rows),
    )


def page(known: Results, tested: pd.DataFrame, ends: pd.DataFrame) -> str:
    """Return docs/paper.md, of the results, the tests on unseen phantoms, and how episodes end."""
    own = next(iter(scores.parts(known).values()))
    agents = named(own.trials)
    ours = own.of(own.trials[agents["agent"] == AGENT])
    both = ("fp", "pp")
    tenths = (
        "In every trial, the mean over training episodes of the last tenth of training is {} than that of "
        "the first."
    )
    sentences = [
        trend(
            ours,
            "return",
            True,
            "For both tasks, the return increased with the number of policy update iterations",
            tenths.format("larger"),
            both,
        ),
        trend(
            ours,
            "final_distance_mm",
            False,
            "The average distances … for the PP task … decreased with time",
            tenths.format("smaller") + " Final distance in mm, Figure 5 (a).",
            ("pp",),
        ),
        trend(
            ours,
            "abs_sin_angle",
            False,
            "… and scanning plane … decreased with time",
            tenths.format("smaller") + " Sine of the final angle between the planes, Figure 5 (b).",
            ("pp",),
        ),
        noise(ours),
        *endings(ours, ends),
        learned(ours),
    ]
    parts = [
        "# The paper's results beside ours",
        ABOUT.format(
            agent=AGENT,
            n_seeds=ours.trials["seed"].nunique(),
            steps=int(ours.trials["steps"].max()),
            seeds=f"{ours.trials['seed'].min()} to {ours.trials['seed'].max()}",
        ),
        table(["sentence", "here"], [[f"“{sentence.words}”", sentence.holds] for sentence in sentences]),
        FIGURES,
        *(sentence.markdown() for sentence in sentences),
        f"## “{OTHERS}”",
        *verdict.sentences(known, tested),
    ]
    return "\n\n".join(parts) + "\n"


def main() -> None:
    """Write the page and its two figures, and name them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=PAGE, help="page to write (default docs/paper.md)")
    args = parser.parse_args()
    known = tables.read(COMMITTED)
    args.out.write_text(page(known, held_out.read(COMMITTED), pd.read_csv(ENDS)), encoding="utf-8")
    print(args.out)
    own = next(iter(scores.parts(known).values()))
    ours = own.of(own.trials[named(own.trials)["agent"] == AGENT])
    for name, figure in (("paper_figure4", paper.figure4(ours)), ("paper_figure5", paper.figure5(ours))):
        if figure is not None:
            print(style.save(figure, args.out.with_name(f"{name}.png")))


if __name__ == "__main__":
    main()
