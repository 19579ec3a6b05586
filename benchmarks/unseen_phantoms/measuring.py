"""The numbers of a finished trial of a table."""

from dataclasses import replace

import numpy as np

from unseen_phantoms.studies import Variant
from unseen_phantoms.trial_table import Row
from usbench.records import Trial
from usbench.setting import Setting
from usbench.trials.evaluation import Evaluator
from usbench.trials.model_loading import load_agent


def measured(table: str, variant: Variant, trial: Trial) -> Row:
    """Return the row of a finished trial of a variant."""
    phantoms = trial.config.environment["phantoms"]
    return Row(
        table=table,
        variant=variant.title,
        phantoms=variant.n_phantoms,
        steps=trial.config.steps,
        seed=trial.config.seed,
        digest=phantoms.get("digest", ""),
        known=known_score(trial),
        unseen=float(trial.last_evaluation(deterministic=True)["normalized_score"].mean()),
        minutes=trial.timings["training_s"] / 60,
    )


def known_score(trial: Trial) -> float:
    """Return the greedy score on phantoms of the training, from the starts of the evaluation.

    The phantoms are the last ones of which an episode has ended, as many as the evaluation has, or all.

    Raises:
        ValueError: If no episode of the training has ended.
    """
    setting = Setting.recorded(trial.config)
    trained = trial.episodes()
    if trained.empty:
        raise ValueError(f"no phantom is known where no episode has ended ({trial.config.steps} steps).")
    met = list(dict.fromkeys(reversed(trained["phantom"].tolist())))[: setting.row.phantoms]
    episodes = tuple(
        replace(episode, phantom=int(met[episode.phantom_index % len(met)]))
        for episode in setting.evaluation_episodes()
    )
    agent = load_agent(trial.folder, algo=trial.config.algo).agent
    played = Evaluator(setting, episodes).play(agent, checkpoint=0, step=0, deterministic=True)
    return float(setting.anchors(episodes=episodes).score(np.mean([one.return_ for one in played])))
