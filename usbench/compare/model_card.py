"""The model card of a released agent, written from the records of its trial.

Its parts follow Mitchell et al., "Model Cards for Model Reporting" (2019): what the agent is, for
what, how it was evaluated, how it was trained, and what it cannot do.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pandas as pd
from scipy import stats

from usbench import records, seed_pools
from usbench.agents.hyperparameters import as_set
from usbench.agents.zoo import entry
from usbench.ceilings import taught
from usbench.records import Trial, TrialConfig
from usbench.results import held_out, sources, tables
from usbench.results import scores as results
from usbench.results.text import in_lines, table
from usbench.setting import Setting
from usbench.trials.configuration import resolve

# The paper's agent is released on the paper's tasks, whether it is the best there or not.
OWN = "vpg"
N_RESAMPLES = 10_000
N_WORST = 3
# Scores that differ less are the same: tables keep five decimals.
SAME = 1e-4


class Rival(NamedTuple):
    """A trial among which an agent was chosen: its name, algorithm, seed and score."""

    trial: str
    algo: str
    seed: int
    score: float


def text(trial: Trial, name: str, rivals: Sequence[Rival], weights: str) -> str:
    """Return the card as Markdown.

    Args:
        trial: The trial whose agent is released.
        name: What the agent is called, for example "best:pp".
        rivals: All trials among which it was chosen, itself among them.
        weights: SHA-256 of the file of its weights.
    """
    setting = Setting.recorded(trial.config)
    greedy = trial.last_evaluation(deterministic=True)
    parts = {
        f"{name}: {trial.config.algo} on {trial.config.task}": _what(trial, setting, name),
        "How well it does": _evaluation(trial, setting, greedy),
        "How it was chosen": _choice(trial, rivals),
        "How it was trained": _training(trial),
        "What it cannot do": _limits(trial, setting, greedy),
        "Digests": _digests(trial, weights),
    }
    (title, first), *others = parts.items()
    sections = [f"# {title}\n\n{first}", *(f"## {heading}\n\n{body}" for heading, body in others)]
    return "\n\n".join(sections) + "\n"


def _what(trial: Trial, setting: Setting, name: str) -> str:
    config = trial.config
    seen = "a B-mode frame" if config.n_frames == 1 else f"the last {config.n_frames} B-mode frames"
    rows = {
        "task": f"`{config.task}` (`{setting.row.env_id}`): {setting.guidance.title}",
        "algorithm": f"`{config.algo}`: {entry(config.algo).title}",
        "sees": f"{seen}, {setting.imaging.height_px} x {setting.imaging.width_px} pixels",
        "is told": ", ".join(setting.senses or ()) or "nothing beside the frames",
        "chooses among": ", ".join(action.name for action in setting.guidance.actions),
    }
    guide = f", `usbench guide {name}` lets it advise a person," if setting.row.is_guided else ""
    used = (
        f'`usbench watch {name}` shows it{guide} and `usbench.load_agent("{name}")` returns it: its `agent` '
        "acts, and its `make_env()` makes an environment that shows what the agent saw."
    )
    return f"{table(('', ''), rows.items(), 2)}\n\n{used}"


def _evaluation(trial: Trial, setting: Setting, greedy: pd.DataFrame) -> str:
    means = records.means(greedy)
    low, high = interval(greedy["normalized_score"].to_numpy(np.float64))
    rows: list[tuple[str, ...]] = [
        (
            "this agent",
            f"{means['return']:.2f}",
            f"{trial.anchors.score(means['return']):.3f} [{low:.3f}, {high:.3f}]",
        ),
        ("optimum", f"{trial.anchors.optimal:.2f}", "1"),
        ("random agent", f"{trial.anchors.random:.2f}", "0"),
    ]
    success = "The last pose is the goal"
    if setting.guidance.reward_from_frames:
        success = "The cyst's contrast-to-noise ratio in the last frame is at least 2"
    where = "unseen phantoms" if setting.row.phantoms else "the phantom of the training"
    return (
        f"{len(greedy)} evaluation episodes on {where}, greedy actions; in brackets the 95 % bootstrap "
        "interval of their mean. It can reach beyond 1, since an episode that starts far from the goal "
        f"cannot earn as much as one that starts near it. {success} in "
        f"{100 * means['success_rate']:.0f} % of the episodes.\n\n" + table(("", "return", "score"), rows, 3)
    )


def interval(scores: npt.NDArray[np.float64]) -> tuple[float, float]:
    """Return the 95 % percentile bootstrap interval of the mean of scores (n_episodes,)."""
    if np.ptp(scores) == 0:
        return float(scores[0]), float(scores[0])
    found = stats.bootstrap(
        (scores,), np.mean, n_resamples=N_RESAMPLES, method="percentile", rng=np.random.default_rng(0)
    )
    return float(found.confidence_interval.low), float(found.confidence_interval.high)


def _choice(trial: Trial, rivals: Sequence[Rival]) -> str:
    seed = trial.config.seed
    pool = seed_pools.own().of(seed) or "no"
    ranked = sorted(rivals, key=lambda one: (-one.score, one.algo, one.seed))
    if len(ranked) == 1:
        return (
            f"The package was made from this one trial (seed {seed}, of the pool for {pool})."
            f"{_better(trial, ranked[0].score)}"
        )
    return (
        f"It is the trial of seed {seed} (of the pool for {pool}) with the highest score, of the "
        f"{len(ranked)} trials below. A score by which an agent was chosen is higher than what its "
        f"algorithm reaches on average.{_others_again(ranked)}{_better(trial, ranked[0].score)}\n\n"
        + table(
            ("algorithm", "seed", "score"),
            [(f"`{one.algo}`", str(one.seed), f"{one.score:.3f}") for one in ranked],
            3,
        )
    )


def _better(trial: Trial, score: float) -> str:
    """Return a sentence where other trials of the leaderboard have a higher score on the task.

    Agents that are told the truth while they learn do not count. Of the paper's agent nothing is said: it is
    released whether others are better or not.
    """
    if trial.config.algo == OWN:
        return ""
    known = tables.read(sources.published())
    final = known.trials.merge(results.last(known)[["trial", "normalized_score"]], on="trial")
    final = final[(final["task"] == trial.config.task) & (final["noise"] == 0) & (final["steps"] > 0)]
    final = final[~final["algo"].map(taught).astype(bool) & (final["trial"] != trial.name)]
    better = final[final["normalized_score"] > score + SAME].sort_values("normalized_score")
    if better.empty:
        return ""
    best = better.iloc[-1]
    trials = "1 trial" if len(better) == 1 else f"{len(better)} trials"
    return (
        f" The leaderboard has {trials} with a higher score on this task: the best is `{best['algo']}` with "
        f"seed {best['seed']}, {best['normalized_score']:.3f}."
    )


def _others_again(listed: Sequence[Rival]) -> str:
    """Return a sentence where the leaderboard has other scores of these trials."""
    final = results.last(tables.read(sources.published()))
    there = dict(zip(final["trial"], final["normalized_score"], strict=True))
    n_other = sum(abs(there.get(one.trial, one.score) - one.score) > SAME for one in listed)
    if not n_other:
        return ""
    return (
        f" In the leaderboard {n_other} of them {'has' if n_other == 1 else 'have'} another score: a "
        "trial that is repeated on another kind of processor rounds otherwise, and takes another course."
    )


def _training(trial: Trial) -> str:
    config = trial.config
    rows = trial.evaluations()
    curve = rows[rows["deterministic"]].groupby("checkpoint")["normalized_score"].mean()
    minutes = trial.timings.get("training_s", 0.0) / 60
    settings = ", ".join(as_set(config.hyperparameters))
    versions = ", ".join(f"{name} {version}" for name, version in sorted(trial.versions.items()))
    return (
        f"{config.steps} steps without noise, {minutes:.1f} minutes on one core:\n\n"
        f"```\n{in_lines(' '.join(['usbench run', *options(config)]))}\n```\n\n"
        f"Hyperparameters: {settings}. Versions: {versions}.\n\nThe learning curve, greedy actions:\n\n"
        + table(("step", "score"), [(str(step), f"{score:.3f}") for step, score in curve.items()], 2)
        + _again(trial, float(curve.iloc[-1]))
    )


def _again(trial: Trial, score: float) -> str:
    """Return a paragraph where the leaderboard's trial of the same name has another score."""
    rows = tables.read(sources.published()).curves
    rows = rows[(rows["trial"] == trial.name) & (rows["kind"] == tables.GREEDY)].sort_values("step")
    if rows.empty or abs(rows["normalized_score"].iloc[-1] - score) < SAME:
        return ""
    return (
        f"\n\nThe leaderboard's trial of this name has {rows['normalized_score'].iloc[-1]:.3f}. This one was "
        "trained again with the same seed: another kind of processor rounds otherwise, and training then "
        "takes another course."
    )


def options(config: TrialConfig) -> list[str]:
    """Return the options of `usbench run` that make this trial, defaults left out."""
    plain = resolve(config.algo, config.task, seed=config.seed)
    found = [f"--algo {config.algo}", f"--task {config.task}", f"--seed {config.seed}"]
    for name in ("steps", "n_frames", "n_envs"):
        if getattr(config, name) != getattr(plain, name):
            found.append(f"--{name.replace('_', '-')} {getattr(config, name)}")
    senses = config.environment.get("senses", ())
    if senses != plain.environment.get("senses", ()):
        found.append(f"--senses {' '.join(senses)}")
    changed = {
        name: value
        for name, value in config.hyperparameters.items()
        if plain.hyperparameters.get(name) != value
    }
    if changed:
        found.append("--set " + " ".join(as_set(changed)))
    return found


def _limits(trial: Trial, setting: Setting, greedy: pd.DataFrame) -> str:
    said = [
        "It has only ever seen simulated frames of a phantom: it says nothing about patients, and is no "
        "medical device.",
        "It knows one probe and one imaging, the defaults. With others, its advice means nothing.",
        "It was trained without noise: where its actions may fail, it does worse.",
    ]
    if setting.row.phantoms:
        said.append("It knows tissue of the kind of these phantoms, with the same object of six balls.")
    else:
        said.append("It knows one phantom. " + _unseen(trial))
    missed = greedy[~greedy["is_success"].astype(bool)].sort_values("return", kind="stable")
    if not missed.empty:
        worst = ", ".join(
            f"{row['eval_episode']} (score {row['normalized_score']:.2f})"
            for row in missed.head(N_WORST).to_dict("records")
        )
        said.append(
            f"It does not end at the goal in {len(missed)} of {len(greedy)} episodes; the worst: {worst}."
        )
    return "\n".join(f"* {sentence}" for sentence in said)


def _unseen(trial: Trial) -> str:
    """Return what the track of unseen phantoms says of this trial."""
    if trial.config.task not in held_out.MANY:
        return "On other phantoms its advice means little."
    tested = held_out.read(sources.published())
    own = tested[tested["trial"] == trial.name].to_dict("records")
    if not own:
        return "On other phantoms its advice means little (`usbench transfer` measures how little)."
    return f"On unseen phantoms (`{own[0]['task']}`) its score is {own[0]['normalized_score']:.3f}."


def _digests(trial: Trial, weights: str) -> str:
    frames = trial.frames.digest if trial.frames else "none"
    return table(
        ("", "SHA-256"),
        [
            ("frames of the evaluation", f"`{frames}`"),
            ("weights", f"`{weights}`"),
            ("trial", f"`{trial.name}`"),
        ],
        2,
    )
