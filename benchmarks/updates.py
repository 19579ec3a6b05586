"""How large the updates of a policy were, how certain the policy became, and the score: a row per trial.

The numbers come from the TensorBoard events of each trial, for algorithms that write `train/approx_kl`, as
PPO does: means over the first tenth of training, the time up to the first quarter, and the rest.
"""

import argparse
import json
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from usbench.results import collecting, scores

PARTS = (0.0, 0.1, 0.25, 1.0)
TAGS = {"KL divergence of an update": "train/approx_kl", "entropy (nats)": "train/entropy_loss"}


def means(values: np.ndarray) -> str:
    """Return the means of `values` over the parts of training, as text."""
    bounds = [round(part * len(values)) for part in PARTS]
    return "  ".join(
        f"{values[first:last].mean():6.3f}" for first, last in zip(bounds[:-1], bounds[1:], strict=True)
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=Path, default=Path("runs"), help="folder of trials (default runs)")
    parser.add_argument("--algo", default="ppo", help="algorithm (default ppo)")
    args = parser.parse_args()
    found = collecting.collect(args.runs)
    trials = found.trials[(found.trials["algo"] == args.algo) & (found.trials["status"] == "finished")]
    final = scores.last(found).set_index("trial")["normalized_score"]
    table = Table(
        "task",
        "noise",
        "seed",
        "learning rate",
        "score",
        *TAGS,
        title=f"{args.algo}: 0 to 10, 25, 100 % of training",
    )
    for trial in trials.itertuples():
        events = EventAccumulator(str(args.runs / trial.trial / "tensorboard"), size_guidance={"scalars": 0})
        events.Reload()
        columns = [means(np.abs([event.value for event in events.Scalars(tag)])) for tag in TAGS.values()]
        settings = json.loads(trial.settings)
        table.add_row(
            trial.task, f"{trial.noise:g}", str(trial.seed), f"{settings['learning_rate']:g}",
            f"{final[trial.trial]:.2f}", *columns,
        )  # fmt: skip
    Console(width=110).print(table)


if __name__ == "__main__":
    main()
