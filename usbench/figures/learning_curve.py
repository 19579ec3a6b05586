"""The learning curve of one trial, from its records alone."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from usbench.figures import looks, style
from usbench.records import LEARNING_CURVE, Trial

SMOOTHING_EPISODES = 40
# Whether actions are greedy, label and look: both in the agent's colour, greedy actions with its marker, so
# that a grey print can be read.
EVALUATIONS: tuple[tuple[bool, str, dict[str, Any]], ...] = (
    (
        False,
        "evaluation, sampled actions (band: standard deviation)",
        {"linestyle": "--", "marker": ".", "alpha": 0.6, "markersize": 4},
    ),
    (True, "evaluation, greedy actions", {"linestyle": "-", "markersize": 5}),
)


def write(folder: Path) -> Path:
    """Draw `learning_curve.png` of the trial in `folder` into it and return the path; errors as of `draw`."""
    figure = draw(Trial.read(folder))
    return style.save(figure, folder / LEARNING_CURVE)


def draw(trial: Trial) -> Figure:
    """Draw the return of a trial over its training steps; the normalised score stands on the right.

    Drawn are training episodes (moving mean), every evaluation (mean and standard deviation over its
    episodes; with sampled actions only where these are no exploration), and lines for the random agent, the
    optimum and, where it is known, the ceiling of an agent's knowledge.

    Raises:
        ValueError: If the trial has no evaluations.
    """
    evaluations, anchors = trial.evaluations(), trial.anchors
    if evaluations.empty:
        raise ValueError(f"{trial.folder} has no evaluations to draw.")
    figure, panels = style.panels(1, 1, height=3.9)
    axes = panels[0, 0]
    own = looks.agents([trial.config.algo])[trial.config.algo]
    color = own["color"]

    episodes = trial.episodes()
    if not episodes.empty:
        smooth = episodes["return"].rolling(SMOOTHING_EPISODES, min_periods=1).mean()
        label = f"training, mean of {SMOOTHING_EPISODES} episodes"
        axes.plot(episodes["step"], smooth, color="0.65", label=label)
    # Exploration is no policy, and no row of scores either.
    for greedy, label, look in EVALUATIONS:
        if trial.samples_to_explore and not greedy:
            continue
        returns = evaluations[evaluations["deterministic"] == greedy].groupby("step")["return"]
        mean, spread = returns.mean(), returns.std(ddof=0)
        axes.plot(mean.index, mean, label=label, **own | look)
        if not greedy:
            axes.fill_between(mean.index, mean - spread, mean + spread, color=color, alpha=0.18, linewidth=0)
    axes.axhline(anchors.optimal, color="black", linewidth=1, linestyle="-.", label="optimum")
    if trial.ceiling is not None:
        line = anchors.return_of(trial.ceiling)
        axes.axhline(line, color="0.4", linewidth=1, linestyle="--", label="ceiling of what it is told")
    axes.axhline(anchors.random, color="black", linewidth=1, linestyle=":", label="random agent")

    axes.set_title(trial.title, fontsize=style.TEXT + 1)
    axes.set_xlabel("training steps")
    axes.set_ylabel("return per episode (sum of its rewards)")
    style.legend(figure, *axes.get_legend_handles_labels())
    score = axes.secondary_yaxis(
        "right",
        functions=(
            lambda value: anchors.score(np.asarray(value)),
            lambda value: anchors.return_of(np.asarray(value)),
        ),
    )
    score.tick_params(labelsize=style.SMALL)
    score.set_ylabel("normalised score (0 random agent, 1 optimum)", fontsize=style.TEXT)
    return figure
