"""The paper's results sentence by sentence beside ours: `make paper` writes docs/paper.md and its figures.

All numbers are from the committed tables, and whether a sentence holds follows from them by the rule that
stands beside it.
"""

import argparse
import functools
from pathlib import Path

import pandas as pd
from paper_sentences import endings, training
from paper_sentences.sentence import AGENT, first, section

from usbench.figures import paper, style
from usbench.results import additions, held_out, scores, tables, verdict
from usbench.results.agents import named
from usbench.results.tables import Results
from usbench.results.text import table

TOP = Path(__file__).parents[1]
COMMITTED, PAGE = TOP / "leaderboard_files", TOP / "docs" / "paper.md"
ONE_FRAME = TOP / "tables" / "one-frame"

ABOUT = """\
This page is written by `make paper` from the tables of the [leaderboard](../leaderboard.md), of [how
episodes end](failures.md) and of the [trials with one frame](../tables/one-frame/leaderboard.md); it is not
edited by hand. Each sentence of [the paper](cite.md)'s results, and of what its abstract says of them, stands
beside what `{agent}` does here: the paper's algorithm with its Table II, {steps} training steps and two kinds
of observations. The paper has 4 seeds.

{trained}

Whether a sentence holds follows from the numbers, by the rule that stands with it. The simulator is another
one than the paper's: shapes and signs can be compared, heights cannot."""
TRAINED = {
    "4 frames": "as every agent of the leaderboard sees them",
    "1 frame": "as the paper's agent saw it; trained [after all others](protocol.md#what-was-done-otherwise)",
}
OTHERS = "It would certainly be worth to evaluate the performance of other reinforcement learning methods"
FIGURES = """\
The figures are Figures 4 and 5 of the paper, with its axes: means over seeds, bars of one standard
deviation, and policy updates of 64 steps on the upper axis. The upper panels are of 4 frames, the lower
ones of 1 frame. The third panel of Figure 5 is not in the paper. The paper's own curves are not drawn
beside ours: this repository has neither their numbers nor its pictures, and heights could not be
compared.

![Figure 4: return of training episodes on both tasks](paper_figure4.png)

![Figure 5: final distance and sine of the final angle](paper_figure5.png)"""


def agents(known: Results) -> dict[str, Results]:
    """Return the trials of the paper's agent by what it sees, those of the leaderboard `known` first."""
    grid = next(iter(scores.parts(known).values()))
    ours = grid.of(grid.trials[named(grid.trials)["agent"] == AGENT])
    return dict(zip(TRAINED, (ours, tables.read(ONE_FRAME / COMMITTED.name)), strict=True))


def page(known: Results, tested: pd.DataFrame) -> str:
    """Return docs/paper.md, of the results and the tests on unseen phantoms."""
    seen = agents(known)
    ends = dict(zip(TRAINED, map(pd.read_csv, (endings.ENDS, ONE_FRAME / endings.ENDS.name)), strict=True))
    found = [
        [*training.changes(own), *endings.endings(own, ends[name]), training.learned(own)]
        for name, own in seen.items()
    ]
    sentences = [dict(zip(seen, each, strict=True)) for each in zip(*found, strict=True)]
    rows = [[f"“{first(each).words}”", *(one.holds for one in each.values())] for each in sentences]
    parts = [
        "# The paper's results beside ours",
        ABOUT.format(
            agent=AGENT,
            steps=int(seen["4 frames"].trials["steps"].max()),
            trained="\n".join(trained(name, own.trials) for name, own in seen.items()),
        ),
        table(["sentence", *seen], rows),
        FIGURES,
        *map(section, sentences),
        f"## “{OTHERS}”",
        *verdict.sentences(known, tested),
    ]
    return "\n\n".join(parts) + "\n"


def trained(name: str, trials: pd.DataFrame) -> str:
    """Return in a line what agents saw, and with which seeds they were trained."""
    seeds = trials["seed"]
    each = f"{seeds.nunique()} seeds in each cell ({seeds.min()} to {seeds.max()})"
    return f"* **{name}** at a time, {TRAINED[name]}: {each}."


def main() -> None:
    """Write the page and its two figures, and name them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=PAGE, help="page to write (default docs/paper.md)")
    args = parser.parse_args()
    known = tables.read(COMMITTED)
    args.out.write_text(page(known, held_out.read(COMMITTED)), encoding="utf-8")
    print(args.out)
    both = functools.reduce(additions.joined, agents(known).values())
    for name, figure in (("paper_figure4", paper.figure4(both)), ("paper_figure5", paper.figure5(both))):
        if figure is not None:
            print(style.save(figure, args.out.with_name(f"{name}.png")))


if __name__ == "__main__":
    main()
