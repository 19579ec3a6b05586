"""Figures from records alone; matplotlib's object interface, so that no global state is left behind."""

from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from usbench import records
from usbench.atomic import atomic_file
from usbench.journal import read_rows

LEARNING_CURVE = "learning_curve.png"
SMOOTHING_EPISODES = 40


def learning_curve(folder: Path) -> Path:
    """Draw `learning_curve.png` of one trial into its folder and return the path.

    Training return (moving mean), evaluation return at every checkpoint (mean and standard deviation over the
    episodes), lines for the random hand and the optimum; the normalised score stands on the right.

    Raises:
        ValueError: If the trial has no evaluations.
    """
    state = records.read_state(folder)
    evaluations = pd.DataFrame(read_rows(folder / records.EVALUATIONS))
    if evaluations.empty:
        raise ValueError(f"{folder} has no evaluations to draw.")
    config, anchors = state["config"], state["anchors"]
    figure = Figure(figsize=(7.5, 5), dpi=150, layout="constrained")
    axes = figure.add_subplot()

    episodes = pd.DataFrame(read_rows(folder / records.EPISODES))
    if not episodes.empty:
        smooth = episodes["return"].rolling(SMOOTHING_EPISODES, min_periods=1).mean()
        axes.plot(
            episodes["step"], smooth, color="0.65", label=f"training, mean of {SMOOTHING_EPISODES} episodes"
        )
    # Told apart by line style and marker as well as by colour, so that they survive a grey print.
    for deterministic, label, style, color in (
        (False, "evaluation, stochastic (band: standard deviation)", "-o", "#0072b2"),
        (True, "evaluation, deterministic", "--s", "#d55e00"),
    ):
        chosen = evaluations[evaluations["deterministic"] == deterministic].groupby("step")["return"]
        mean, spread = chosen.mean(), chosen.std(ddof=0)
        axes.plot(mean.index, mean, style, color=color, markersize=4, label=label)
        if not deterministic:
            axes.fill_between(mean.index, mean - spread, mean + spread, color=color, alpha=0.18, linewidth=0)
    axes.axhline(anchors["optimal"], color="black", linewidth=1, linestyle="-.", label="optimal")
    axes.axhline(anchors["random"], color="black", linewidth=1, linestyle=":", label="random")

    axes.set_title(
        f"{config['algo']} on {config['task']}, noise {config['noise']:g}, seed {config['seed']}", fontsize=11
    )
    axes.set_xlabel("training steps")
    axes.set_ylabel("return per episode (sum of 16 rewards)")
    axes.grid(alpha=0.3)
    figure.legend(fontsize=8, loc="outside lower center", ncols=3)
    span = anchors["optimal"] - anchors["random"]
    score = axes.secondary_yaxis(
        "right",
        functions=(
            lambda value: (np.asarray(value) - anchors["random"]) / span,
            lambda value: np.asarray(value) * span + anchors["random"],
        ),
    )
    score.set_ylabel("normalised score (0 random, 1 optimal)")

    path = folder / LEARNING_CURVE
    with atomic_file(path) as file:
        # No date or version in the file: same records, same bytes.
        figure.savefig(file, format="png", metadata={"Software": None})
    return path
