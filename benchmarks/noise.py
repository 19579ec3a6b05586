"""Examine trained agents where the probe slips more often, or less, than in their training.

`python benchmarks/noise.py best:pp-tracked best:fp-random` takes folders of trials and agents that come with
the package. Each plays the evaluation episodes of its task with greedy actions, once with each `--noise`: the
same episodes, with the same slips, that agents trained with that noise meet. Scores are anchored for each
noise by itself. Trials that differ in their seed alone have an interquartile mean (IQM) below them.

With `--greedy-shift-px 2` agents of `double_dqn` take the actions of means over pictures moved sideways by up
to so many pixels, whatever they were trained with: the training is the same.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from rich.console import Console
from rich.table import Table

from usbench.agents.hyperparameters import check
from usbench.checks import probability
from usbench.records import ConfigurationError, TrialConfig
from usbench.results import stats
from usbench.setting import Setting
from usbench.trials.evaluation import Evaluator
from usbench.trials.model_loading import load_agent

NOISES = (0.0, 0.25, 0.5)
SHIFT = "greedy_shift_px"


@dataclass(frozen=True)
class Examined:
    """An agent's score, and how many of its episodes end at the goal, `(n_noises,)` each."""

    config: TrialConfig
    scores: tuple[float, ...]
    at_goal: tuple[float, ...]

    @property
    def agent(self) -> TrialConfig:
        """What agents have in common that differ in their seed alone."""
        return replace(self.config, seed=0)


def examine(place: str, noises: Sequence[float], shift_px: int | None = None) -> Examined:
    """Return how the agent of a trial, or of the package, does with each noise.

    Args:
        place: Folder of the trial, or name of the agent.
        noises: Probabilities of a slip.
        shift_px: In place of the agent's own `greedy_shift_px`, None to keep it.

    Raises:
        ConfigurationError: If there is no such agent, or its actions do not follow from such means.
    """
    loaded = load_agent(place)
    setting = Setting.recorded(loaded.config)
    if shift_px is not None:
        policy = getattr(loaded.agent, "policy", None)
        if not hasattr(policy, SHIFT):
            raise ConfigurationError(f"{place} takes no {SHIFT}: allowed are agents of double_dqn.")
        setattr(policy, SHIFT, check(SHIFT, shift_px))
    played = [_played(loaded.agent, replace(setting, noise=noise)) for noise in noises]
    return Examined(loaded.config, *zip(*played, strict=True))


def _played(agent: object, setting: Setting) -> tuple[float, float]:
    """Return the mean score over the evaluation episodes, and the share of them that end at the goal."""
    evaluator = Evaluator(setting, setting.evaluation_episodes())
    episodes = evaluator.play(agent, checkpoint=0, step=0, deterministic=True)
    evaluator.close()
    mean_return = float(np.mean([episode.return_ for episode in episodes]))
    return setting.anchors().score(mean_return), float(np.mean([episode.is_success for episode in episodes]))


def table(examined: Sequence[Examined], noises: Sequence[float]) -> Table:
    """Return a row per agent, and one for the interquartile mean of those that differ in their seed alone."""
    columns = ("agent", "task", "trained with noise", "seed", *(f"noise {noise:g}" for noise in noises))
    shown = Table(*columns, caption="Score, and in brackets the episodes that end at the goal.")
    for agent in dict.fromkeys(one.agent.folder_name for one in examined):
        alike = [one for one in examined if one.agent.folder_name == agent]
        config = alike[0].config
        what = (config.algo, config.task, f"{config.noise:g}")
        for one in alike:
            numbers = zip(one.scores, one.at_goal, strict=True)
            shown.add_row(
                *what, str(one.config.seed), *(f"{score:.3f} ({goal:.0%})" for score, goal in numbers)
            )
        if len(alike) > 1:
            every = np.array([one.scores for one in alike])
            shown.add_row(*what, "IQM", *(f"{float(stats.iqm(each[:, np.newaxis])):.3f}" for each in every.T))
    return shown


def main() -> None:
    """Examine the agents and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("agents", nargs="+", metavar="TRIAL", help="folders of trials, or best:TASK")
    parser.add_argument(
        "--noise", nargs="+", type=float, default=NOISES, metavar="P", help="default: 0 0.25 0.5"
    )
    parser.add_argument(
        "--greedy-shift-px", type=int, metavar="N", help="as usbench run --set takes it (default: as trained)"
    )
    args = parser.parse_args()
    torch.set_num_threads(1)  # as in training: the bits do not depend on the machine
    try:
        noises = [probability("noise", noise) for noise in args.noise]
        examined = [examine(place, noises, args.greedy_shift_px) for place in args.agents]
    except ValueError as error:
        parser.error(str(error))
    Console(width=110).print(table(examined, noises))


if __name__ == "__main__":
    main()
