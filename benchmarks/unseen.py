"""What helps on phantoms never seen, and how many training phantoms it takes: `make unseen`.

Trains `double_dqn` on `pp-tracked` with one thing changed at a time (ablations), or on fixed sets of
phantoms, `distilled` beside it (the gap between known and unseen ones). Trials go into a folder; what is
finished there is not run again. Seeds are those for development: no leaderboard takes these trials.
"""

import argparse
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from usbench import seed_pools
from usbench.agents import zoo
from usbench.agents.value_based.double_dqn import DoubleDQN
from usbench.records import Trial, TrialConfig
from usbench.results import stats
from usbench.setting import Setting
from usbench.trials import runner
from usbench.trials.configuration import resolve
from usbench.trials.evaluation import Evaluator
from usbench.trials.model_loading import load_agent

ALGO, TASK = "double_dqn", "pp-tracked"
SETTING = {"n_frames": 2, "senses": ("position", "heading", "actions")}
LEARNERS = (ALGO, "distilled")
COUNTS = (1, 20, 200, 2000, None)


class WithoutViews(DoubleDQN):
    """The agent without symmetries: neither in what it remembers nor in its values."""

    takes_symmetries = False


ROW = zoo.ZOO[ALGO]
WITHOUT_VIEWS = replace(ROW, cls="unseen:WithoutViews")
PAPERS_TRUNK = replace(
    ROW, policy_kwargs=zoo.TRUNK | {"features_extractor_kwargs": {"batch_statistics": False}}
)


@dataclass(frozen=True)
class Variant:
    """One thing that is changed: the row, hyperparameters, or what the agent sees."""

    title: str
    algo: str = ALGO
    overrides: Mapping[str, Any] = field(default_factory=dict)
    setting: Mapping[str, Any] = field(default_factory=dict)


VARIANTS = (
    Variant("as it is"),
    Variant("without symmetries", algo="unseen:WITHOUT_VIEWS"),
    Variant("returns of one step", overrides={"return_steps": 1}),
    Variant("returns of five steps", overrides={"return_steps": 5}),
    Variant("the paper's trunk", algo="unseen:PAPERS_TRUNK"),
    Variant("one average over the picture", algo=f"{ALGO}+residual"),
    Variant("half the updates", overrides={"gradient_steps": 1}),
    Variant("twice the updates", overrides={"gradient_steps": 4}),
    Variant("a target every 512 steps", overrides={"tau": 1.0, "target_update_interval": 512}),
    Variant("shifts of 2 pixels", overrides={"max_shift_px": 2}),
    Variant("one frame", setting={"n_frames": 1}),
    Variant("without the last action", setting={"senses": ("position", "heading")}),
    Variant("without position and heading", setting={"senses": ("actions",)}),
)


def trained(configs: Iterable[TrialConfig], out: Path) -> list[Trial]:
    """Return the trials of these configurations, run where they are not finished."""
    return [Trial.read(runner.run_trial(config, out).folder) for config in configs]


def score(trial: Trial) -> float:
    """Return the greedy score of the last evaluation, on phantoms never seen."""
    return float(trial.last_evaluation(deterministic=True)["normalized_score"].mean())


def known_score(trial: Trial, count: int | None) -> float:
    """Return the greedy score on phantoms of training, as many as the evaluation has, or as the set."""
    setting = Setting.recorded(trial.config)
    episodes = tuple(
        replace(episode, phantom=episode.phantom_place % (count or setting.row.phantoms))
        for episode in setting.evaluation_episodes()
    )
    played = Evaluator(setting, episodes).play(
        load_agent(trial.folder).agent, checkpoint=0, step=0, deterministic=True
    )
    return float(setting.anchors(episodes=episodes).score(np.mean([one.return_ for one in played])))


def shown(scores: list[float]) -> str:
    """Return the interquartile mean over seeds, with the least and the largest."""
    return f"{float(stats.iqm(np.reshape(scores, (-1, 1)))):.2f} [{min(scores):.2f}, {max(scores):.2f}]"


def ablations(steps: int, seeds: list[int], out: Path) -> Table:
    """Return the scores of every variant."""
    table = Table(
        "variant", "score, unseen phantoms", "CPU minutes", title=f"{ALGO} on {TASK}, {steps} steps"
    )
    for variant in VARIANTS:
        own = {**SETTING, **variant.setting}
        found = trained(
            [
                resolve(variant.algo, TASK, seed=seed, steps=steps, overrides=variant.overrides, **own)
                for seed in seeds
            ],
            out,
        )
        minutes = np.mean([trial.timings["training_s"] / 60 for trial in found])
        table.add_row(variant.title, shown([score(trial) for trial in found]), f"{minutes:.0f}")
    return table


def gap(steps: int, seeds: list[int], out: Path) -> Table:
    """Return the scores on known and on unseen phantoms, by agent and fixed set of training phantoms."""
    head = ("agent", "training phantoms", "set (digest)", "known", "unseen")
    table = Table(*head, title=f"{TASK}, {steps} steps")
    for algo, count in product(LEARNERS, COUNTS):
        found = trained(
            [resolve(algo, TASK, seed=seed, steps=steps, n_phantoms=count, **SETTING) for seed in seeds], out
        )
        known = [known_score(trial, count) for trial in found]
        digest = found[0].config.environment["phantoms"].get("digest", "")
        unseen = shown([score(trial) for trial in found])
        table.add_row(algo, str(count or "no limit"), digest, shown(known), unseen)
    return table


def main() -> None:
    """Train what is missing and print the tables that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tables", nargs="+", choices=("ablations", "gap"), default=["ablations", "gap"])
    parser.add_argument("--steps", type=int, default=50_000, help="training steps (default 50 000)")
    parser.add_argument("--seeds", type=int, default=3, help="development seeds per row (default 3)")
    parser.add_argument("--out", type=Path, default=Path("runs"), help="folder of trials (default runs)")
    args = parser.parse_args()
    seeds = list(range(args.seeds))
    for seed in seeds:
        seed_pools.own().check("development", seed)
    tables = {"ablations": ablations, "gap": gap}
    for name in args.tables:
        Console(width=110).print(tables[name](args.steps, seeds, args.out))


if __name__ == "__main__":
    main()
