"""Evaluation episodes of a trial, selected to be watched, with the agent that can be asked about them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from PIL import Image

from usbench import released
from usbench.checks import as_configuration_error
from usbench.figures import style
from usbench.records import ConfigurationError, Trial
from usbench.setting import Setting
from usbench.waiting import Waiting
from usbench.watch import film, replay
from usbench.watch.moment import Ask, Moment


@dataclass(frozen=True)
class Selection:
    """Episodes of a trial's last evaluation.

    Attributes:
        trial: The trial.
        setting: What its agent meets.
        episodes: Their records.
        actions: How the agent acted in them, "greedy" or "sampled".
        ask: Asks the saved agent; None if it cannot be asked.
        silence: Why it cannot be asked, in a sentence; empty if it can.
    """

    trial: Trial
    setting: Setting
    episodes: tuple[dict[str, Any], ...]
    actions: str
    ask: Ask | None = None
    silence: str = ""

    @property
    def names(self) -> list[str]:
        """Names of the task's actions."""
        return replay.action_names(self.setting)

    def title(self, episode: dict[str, Any]) -> str:
        """Return which episode this is, in words."""
        return (
            f"{self.trial.title}: evaluation episode {episode['eval_episode']} at step "
            f"{episode['checkpoint']}, {self.actions} actions"
        )

    def moments(self, episode: dict[str, Any]) -> Iterator[Moment]:
        """Yield what there is to see in an episode, step by step."""
        return replay.play(self.setting, int(episode["eval_episode"]), episode["actions"], ask=self.ask)


def choose(folder: Path, numbers: Sequence[Any] = (), *, sampled: bool = False) -> Selection:
    """Return the episodes `numbers` of a trial's last evaluation; without any, the one of median return.

    Args:
        folder: Of the trial, or the name of an agent that comes with the package ("best:pp").
        numbers: Of evaluation episodes.
        sampled: Whether to select from the episodes with sampled actions, not from those with greedy ones.

    Raises:
        ConfigurationError: If `folder` is no trial with evaluations, or has no such episode.
    """
    folder = released.place(folder)
    with as_configuration_error():
        trial = Trial.read(folder)
        evaluation = trial.last_evaluation(deterministic=not sampled)
    by_number = {row["eval_episode"]: row for row in evaluation.to_dict("records")}
    for number in numbers:
        if number not in by_number:
            raise ConfigurationError(
                f"episode must be a whole number from 0 to {max(by_number)}, not {number!r}."
            )
    episodes = tuple(by_number[number] for number in numbers) or (replay.typical(evaluation),)
    ask, silence = _open(folder, trial.config.algo)
    return Selection(
        trial, Setting.recorded(trial.config), episodes, "sampled" if sampled else "greedy", ask, silence
    )


def check_file(out: Path) -> Path:
    """Return `out` if a film can be written there; ConfigurationError if not."""
    return style.check_file(out, film.FORMATS)


def write(selection: Selection, out: Path) -> None:
    """Write the episodes one after the other to `out`, .gif, .webp or .mp4."""
    film.write(out, _pages(selection))


def _pages(selection: Selection) -> Iterator[Image.Image]:
    waiting = Waiting("Drawing the film", len(selection.episodes))
    for episode in selection.episodes:
        for moment in selection.moments(episode):
            yield film.page(moment, len(episode["actions"]), selection.names, selection.title(episode))
        waiting.done()


def _open(folder: Path, algo: str) -> tuple[Ask | None, str]:
    """Return how to ask the trial's agent, or why it cannot be asked."""
    if ":" in algo:
        return None, (
            f"asking the agent would run the code of {algo!r}, which is not of this package; what it did is "
            "shown as the trial has recorded it."
        )
    # Here, since asking an agent takes torch.
    from usbench.trials.model_loading import load_agent
    from usbench.watch.advice import Adviser

    try:
        return Adviser(load_agent(folder).agent).advise, ""
    except ConfigurationError as error:
        return None, str(error)
