"""How well the reward from the image follows the reward from the pose: `python benchmarks/image_reward.py`.

For each phantom: the rank correlation (Spearman) of the two rewards over all poses that the task can reach,
and how far the pose with the best image is from the goal. Frames that are not kept yet are simulated.
"""

import argparse
import statistics
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.stats import spearmanr

from usbench.envs.frames import frame_store
from usbench.envs.image_reward import likeness, standard_view
from usbench.envs.phantom import Phantom
from usbench.setting import Setting, make_env


def compare(task: str, phantom: Phantom) -> tuple[float, float, float]:
    """Return rank correlation, and distance in mm and angle in degrees of the best image from the goal."""
    env: Any = make_env(task).unwrapped
    store, states = frame_store(phantom, env.probe, env.imaging), env.task.states
    store.prepare(states)
    view = standard_view(env.probe, env.imaging)
    seen = np.array([likeness(store.frame(pose), view) for pose in states])
    true = [env.task.reward(pose, phantom.target, "normalized") for pose in states]
    best = states[int(seen.argmax())]
    turned = (best.angle_deg - phantom.target.angle_deg) % 180
    return (
        float(spearmanr(seen, true).statistic),
        env.task.distance_mm(best, phantom.target),
        min(turned, 180 - turned) if len({pose.angle_deg for pose in states}) > 1 else np.nan,
    )


def main() -> None:
    """Print a table for each task."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tasks", nargs="+", default=["pp", "pp-random", "fp", "fp-random"], metavar="NAME")
    parser.add_argument("--phantoms", type=int, default=8, help="evaluation phantoms to take (default 8)")
    args = parser.parse_args()
    for task in args.tasks:
        head = ("phantom", "x", "depth", "angle", "size", "contrast", "correlation", "off (mm)", "off (deg)")
        table = Table(*head, title=f"{task}: reward from the image against the reward from the pose")
        found = []
        for phantom in Setting(task=task).evaluation_phantoms()[: args.phantoms]:
            correlation, distance_mm, angle_deg = compare(task, phantom)
            ooi = phantom.object_of_interest
            found.append(correlation)
            table.add_row(
                *(str(value) for value in (phantom.seed, ooi.x_mm, ooi.depth_mm, ooi.angle_deg)),
                *(f"{value:.2f}" for value in (ooi.scale, ooi.contrast, correlation)),
                f"{distance_mm:.0f}",
                "" if np.isnan(angle_deg) else f"{angle_deg:.0f}",
            )
        Console(width=110).print(table)
        print(f"{task}: median correlation {statistics.median(found):.2f} over {len(found)} phantoms")


if __name__ == "__main__":
    main()
