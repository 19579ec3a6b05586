"""An evaluation episode played again from its record (seed, start, actions), as an animated picture."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
from PIL import Image, ImageDraw, ImageFont

from usbench import records, suite
from usbench.atomic import atomic_file
from usbench.journal import read_rows

REPLAY = "replay.gif"
CAPTION_HEIGHT, CAPTION_COLOR = 28, (15, 18, 24)
STEP_MS, LAST_STEP_MS = 450, 2000


@dataclass(frozen=True)
class Moment:
    """What is seen after one step: the picture (height, width, 3) uint8, the action, and rewards so far."""

    step: int
    picture: npt.NDArray[np.uint8]
    action: str
    reward: float
    return_: float


def typical_episode(folder: Path) -> dict[str, Any]:
    """Return the record of the last checkpoint's episode, with drawn actions, whose return is the median.

    Raises:
        ValueError: If the trial has no evaluations.
    """
    rows = pd.DataFrame(read_rows(folder / records.EVALUATIONS))
    if rows.empty:
        raise ValueError(f"{folder} has no evaluations to replay.")
    last = rows[(rows["checkpoint"] == rows["checkpoint"].max()) & ~rows["deterministic"]]
    ordered = last.sort_values("return", kind="stable")
    return {str(key): value for key, value in ordered.iloc[len(ordered) // 2].items()}


def play(task: str, noise: float, eval_episode: int, actions: list[int]) -> Iterator[Moment]:
    """Yield what is seen at the start (step 0) and after every recorded action."""
    episode = suite.evaluation_episodes(task)[eval_episode]
    names = [action.name for action in suite.TASKS[task].guidance.actions]
    env = suite.make_env(task, noise, render_mode="rgb_array")
    env.reset(seed=episode.seed, options=episode.options)
    yield Moment(0, _picture(env), "start", 0.0, 0.0)
    total = 0.0
    for step, action in enumerate(actions, start=1):
        reward = float(env.step(action)[1])
        total += reward
        yield Moment(step, _picture(env), names[action], reward, total)
    env.close()


def write_gif(folder: Path) -> Path:
    """Write `replay.gif` of the trial's typical evaluation episode into its folder and return the path."""
    config = records.read_state(folder)["config"]
    record = typical_episode(folder)
    moments = play(config["task"], config["noise"], int(record["eval_episode"]), record["actions"])
    pages = [_page(moment, len(record["actions"])) for moment in moments]
    path = folder / REPLAY
    with atomic_file(path) as file:
        pages[0].save(
            file,
            format="GIF",
            save_all=True,
            append_images=pages[1:],
            duration=[STEP_MS] * (len(pages) - 1) + [LAST_STEP_MS],
            loop=0,
        )
    return path


def _picture(env: Any) -> npt.NDArray[np.uint8]:
    return np.asarray(env.render(), dtype=np.uint8)


def _page(moment: Moment, steps: int) -> Image.Image:
    """Return the picture with a caption below it."""
    height, width, _ = moment.picture.shape
    page = Image.new("RGB", (width, height + CAPTION_HEIGHT), CAPTION_COLOR)
    page.paste(Image.fromarray(moment.picture), (0, 0))
    caption = (
        f"step {moment.step}/{steps}   {moment.action}   "
        f"reward {moment.reward:.2f}   return {moment.return_:.2f}"
    )
    font = ImageFont.load_default(size=14)
    ImageDraw.Draw(page).text((8, height + 6), caption, fill="white", font=font)
    return page
