"""The paper's results sentence by sentence beside ours: `make paper` writes docs/paper.md and its figures.

All numbers are from the committed tables, and whether a sentence holds follows from them by the rule that
stands beside it.
"""

import argparse
from pathlib import Path

import pandas as pd
from paper_sentences import endings, training
from paper_sentences.sentence import AGENT

from usbench.figures import paper, style
from usbench.results import held_out, scores, tables, verdict
from usbench.results.agents import named
from usbench.results.tables import Results
from usbench.results.text import table

TOP = Path(__file__).parents[1]
COMMITTED, PAGE = TOP / "leaderboard_files", TOP / "docs" / "paper.md"

ABOUT = """\
This page is written by `make paper` from the tables of the [leaderboard](../leaderboard.md) and of [how
episodes end](failures.md); it is not edited by hand. Each sentence of [the paper](cite.md)'s results, and of
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


def page(known: Results, tested: pd.DataFrame, ends: pd.DataFrame) -> str:
    """Return docs/paper.md, of the results, the tests on unseen phantoms, and how episodes end."""
    own = next(iter(scores.parts(known).values()))
    agents = named(own.trials)
    ours = own.of(own.trials[agents["agent"] == AGENT])
    sentences = [*training.changes(ours), *endings.endings(ours, ends), training.learned(ours)]
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
    args.out.write_text(page(known, held_out.read(COMMITTED), pd.read_csv(endings.ENDS)), encoding="utf-8")
    print(args.out)
    own = next(iter(scores.parts(known).values()))
    ours = own.of(own.trials[named(own.trials)["agent"] == AGENT])
    for name, figure in (("paper_figure4", paper.figure4(ours)), ("paper_figure5", paper.figure5(ours))):
        if figure is not None:
            print(style.save(figure, args.out.with_name(f"{name}.png")))


if __name__ == "__main__":
    main()
