"""What TensorBoard shows of a trial beside Stable-Baselines3's own: scores between anchors, and frames."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.logger import Image, Logger, TensorBoardOutputFormat

from usbench.envs.frames import frame_store
from usbench.records import Evaluation

RANDOM, OPTIMAL = "anchors/normalized_score_random", "anchors/normalized_score_optimal"
TRAINING = "rollout/normalized_score"
FRAMES = "evaluation/final_frames"
# One chart with all scores between the two anchors, on the tab "Custom Scalars".
LAYOUT = {
    "usbench": {
        "normalised score (0 random, 1 optimum) over training steps": [
            "Multiline",
            ["evaluation/normalized_score_.*", TRAINING, RANDOM, OPTIMAL],
        ]
    }
}
N_FRAMES, GAP_PX = 8, 2
# Where a picture would be text.
_NO_PICTURES = ("stdout", "log", "json", "csv")


def begin(logger: Logger) -> None:
    """Lay out the chart of scores."""
    for output in logger.output_formats:
        if isinstance(output, TensorBoardOutputFormat) and output.writer is not None:
            output.writer.add_custom_scalars(LAYOUT)


def trained(logger: Logger, score: float) -> None:
    """Record the normalised score of the last training episodes, for the next dump."""
    logger.record(TRAINING, score)


def evaluated(agent: BaseAlgorithm, played: Sequence[Evaluation]) -> None:
    """Record the anchors and what the probe saw at the end of some evaluation episodes, for the next dump."""
    agent.logger.record(RANDOM, 0.0)
    agent.logger.record(OPTIMAL, 1.0)
    chosen = [played[len(played) * k // N_FRAMES] for k in range(min(N_FRAMES, len(played)))]
    agent.logger.record(FRAMES, Image(strip(agent, chosen), "HW"), exclude=_NO_PICTURES)


def strip(agent: BaseAlgorithm, played: Sequence[Evaluation]) -> npt.NDArray[np.uint8]:
    """Return the last frames of episodes side by side, (height_px, width) uint8, white between them."""
    env: Any = agent.get_env()
    probe, imaging, task = (env.get_attr(name)[0] for name in ("probe", "imaging", "task"))
    frames = []
    for row in played:
        own = row.phantom is None
        phantom = env.get_attr("phantom")[0] if own else env.get_attr("phantoms")[0].phantom(row.phantom)
        pose = task.pose({name: row.poses[f"final_{name}"] for name in task.coordinates})
        frames.append(frame_store(phantom, probe, imaging).frame(pose))
    gap = np.full((len(frames[0]), GAP_PX), 255, np.uint8)
    parts = [part for frame in frames for part in (frame, gap)]
    return np.concatenate(parts[:-1], axis=1)
