"""Trials for the leaderboard, checked from their records alone: no code of an algorithm is run.

What an agent did in its evaluations is recorded action by action. Played again from the seeds of the fixed
list, these actions must give the recorded returns: nobody has to trust a number that somebody has sent.
"""

import contextlib
import itertools
import math
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from usbench import records, seed_pools, suite
from usbench.checks import ConfigurationError
from usbench.own_task import is_on_its_task, task_environment
from usbench.records import Trial
from usbench.records.facts import Facts
from usbench.results import collecting
from usbench.results.protocol import further, unseen
from usbench.setting import Setting

# What a submission holds of each trial; its weights are not asked for.
FILES = (records.TRIAL, records.EPISODES, records.EVALUATIONS)
# Two sums of rewards that are the same but for the order of rounding; of rewards from frames, but for those.
SAME, SAME_FROM_FRAMES = 1e-6, 1e-2


def problems(folder: Path, *, records_alone: bool = False) -> list[str]:
    """Return in sentences why the trial in `folder` cannot stand in the leaderboard; none if it can.

    `records_alone` asks whether its records are what happened, not whether its seed, its budget and its
    environment are those of the comparison.
    """
    try:
        trial = Trial.read(folder)
        evaluations, episodes = trial.evaluations(), trial.episodes()
    except (ConfigurationError, ValueError) as error:
        return [str(error)]
    if trial.status != "finished":
        return [f"it is not finished, but {trial.status}."]
    try:
        setting = Setting.recorded(trial.config)
    except ConfigurationError as error:
        return [str(error)]
    configuration = [] if records_alone else _of_configuration(trial, setting)
    return [
        *([] if records_alone else _of_name(trial)),
        *configuration,
        *([] if configuration else _of_anchors(trial, setting)),
        *_of_training(trial, episodes),
        *_of_evaluations(trial, evaluations),
        *_of_returns(setting, evaluations),
    ]


def check(runs: Path, tell: Callable[[str], None] = lambda _: None) -> dict[Path, list[str]]:
    """Return the trials in `runs` with their `problems`.

    Raises:
        ConfigurationError: If there is no trial in `runs`.
    """
    folders = records.trial_folders(runs) if runs.is_dir() else []
    if not folders:
        raise ConfigurationError(f"there is no trial in {str(runs)!r}: usbench compare makes some.")
    for other in records.without_record(runs) if folders != [runs] else ():
        tell(f"left out: {other.name} has no {records.TRIAL}.")
    trials = "1 trial" if len(folders) == 1 else f"{len(folders)} trials"
    tell(f"checking {trials}: every evaluation is played again, some seconds for each trial")
    found = {}
    for number, folder in enumerate(folders, 1):
        found[folder] = problems(folder)
        told = "".join(f"\n  {problem}" for problem in found[folder]) or " verified"
        tell(f"[{number}/{len(folders)}] {folder.name}:{told}")
    return found


def other_frames(folders: Sequence[Path], tell: Callable[[str], None] = lambda _: None) -> list[str]:
    """Return in sentences which trials have seen other frames than this machine makes.

    Another kind of processor rounds some pixels otherwise, so that this alone refuses no trial.
    """
    digests: dict[Setting, str] = {}
    found = []
    for trial in (Trial.read(folder) for folder in folders):
        if trial.frames is None:
            continue
        setting = Setting(task=Setting.recorded(trial.config).task)
        if setting not in digests:
            tell(f"frames of {setting.task}, to compare their digest; those that are not kept are simulated")
            digests[setting] = setting.prepare_frames().digest
        if digests[setting] != trial.frames.digest:
            found.append(
                f"{trial.name} has seen other frames than this machine makes: another version of the "
                "simulator, or another kind of processor, which rounds otherwise."
            )
    return found


def write(folders: Sequence[Path], out: Path) -> Path:
    """Copy what is submitted of trials into the folder `out`, made if need be, and return it.

    Raises:
        ConfigurationError: If it cannot be written.
    """
    try:
        for folder in folders:
            (out / folder.name).mkdir(parents=True, exist_ok=True)
            for name in FILES:
                shutil.copyfile(folder / name, out / folder.name / name)
    except OSError as error:
        raise records.unwritable(out, error) from error
    return out


def _of_name(trial: Trial) -> list[str]:
    """Return a sentence if its folder has another name, as that of a rival's trial."""
    own = trial.config.folder_name
    return [] if trial.name == own else [f"its folder must have the name of its configuration, {own}."]


def _of_configuration(trial: Trial, setting: Setting) -> list[str]:
    config, found = trial.config, []
    of_unseen = unseen.has(config.task, config.steps)
    plain = task_environment(config.task)
    if not (is_on_its_task(config) if of_unseen else dict(config.environment) == plain):
        found.append(f"its anatomy, probe, imaging, reward or senses are not those of {config.task}.")
    frames = further.frames_of(config.task, config.noise)
    if config.steps and not of_unseen and config.n_frames not in frames:
        allowed = " or ".join(map(str, sorted(frames)))
        found.append(
            f"its observations have {config.n_frames} frames: those of {config.task} have {allowed}."
        )
    if not of_unseen and config.steps not in (0, setting.row.steps):
        found.append(
            f"it trained for {config.steps} steps: the budget of {config.task} is {setting.row.steps}."
        )
    pool = seed_pools.own().comparison
    if config.steps and config.seed not in pool:
        found.append(f"its seed {config.seed} is not one of those that are kept for comparisons, {pool}.")
    return found


def _of_anchors(trial: Trial, setting: Setting) -> list[str]:
    """Return a sentence if the exact returns, from which all scores follow, are not those of its task."""
    own, exact = trial.anchors, setting.scored.anchors()
    if all(
        abs(getattr(own, name) - getattr(exact, name)) <= _tolerance(setting)
        for name in ("optimal", "random", "stay")
    ):
        return []
    return ["its exact returns (optimum, random, idle agent) are not those of its task and noise."]


def _of_training(trial: Trial, episodes: pd.DataFrame) -> list[str]:
    """Return what is wrong with the training episodes: one ends at least every `longest` steps."""
    config = trial.config
    longest = suite.TASKS[config.task].n_steps * config.n_envs
    if episodes.empty and config.steps > longest:
        return ["it has no training episodes."]
    ends = [0, *(() if episodes.empty else episodes["step"]), config.steps]
    if ends != sorted(ends):
        return [f"its training episodes end after {max(ends)} steps, beyond the budget, or out of order."]
    for before, after in itertools.pairwise(ends):
        if after - before > longest:
            return [
                f"no training episode ends within the {after - before} steps from step {before} to {after}: "
                f"on {config.task} one does within {longest}."
            ]
    return []


def _of_evaluations(trial: Trial, evaluations: pd.DataFrame) -> list[str]:
    """Return what is missing of the evaluations: every point has every episode of the list once.

    A rollout may pass over a point between the first and the last.
    """
    total = trial.config.steps
    points = suite.evaluation_points(trial.config.task, total)
    every = list(range(len(suite.evaluation_episodes(trial.config.task))))
    if evaluations.empty:
        return ["it has no evaluations."]
    there = set(evaluations["checkpoint"])
    for greedy in (True, False):
        rows = evaluations[evaluations["deterministic"] == greedy]
        played = {point: sorted(own) for point, own in rows.groupby("checkpoint")["eval_episode"]}
        is_at_points = {points[0], points[-1]} <= there <= set(points)
        if not is_at_points or played.keys() != there or any(own != every for own in played.values()):
            kind = "greedy" if greedy else "sampled"
            return [
                f"its evaluations with {kind} actions are not the episodes 0 to {every[-1]}, each once, "
                f"at the first and the last of {points} and at those between that it has."
            ]
    early = evaluations["step"] < evaluations["checkpoint"]
    if early.any() or evaluations["step"].max() != total or not collecting.trained_grows(evaluations):
        return [f"its evaluations do not take place at growing training steps, the last at {total}."]
    return []


def _of_returns(setting: Setting, evaluations: pd.DataFrame) -> list[str]:
    """Play every recorded evaluation episode again; return what comes out otherwise."""
    planned, tolerance, wrong = setting.evaluation_episodes(), _tolerance(setting), []
    seen: dict[tuple[int, tuple[int, ...]], dict[str, Any]] = {}
    made: Any = setting.scored.make_env()
    with contextlib.closing(made) as env:
        env.unwrapped.is_watched = setting.guidance.reward_from_frames
        for row in evaluations.to_dict("records"):
            try:
                key = (int(row["eval_episode"]), tuple(int(action) for action in row["actions"]))
                if key not in seen:
                    seen[key] = _played(env, planned[key[0]], key[1])
                facts = seen[key]
                other = [name for name, fact in facts.items() if not _same(fact, row[name], tolerance)]
            except (AssertionError, IndexError, KeyError, OverflowError, TypeError, ValueError) as error:
                wrong.append(f"episode {row.get('eval_episode')} cannot be played again ({error})")
                continue
            if other:
                wrong.append(
                    f"evaluation episode {row['eval_episode']} at step {row['checkpoint']} has the "
                    f"{other[0].replace('_', ' ')} {_number(row[other[0]])}, its actions give "
                    f"{_number(facts[other[0]])}"
                )
    if not wrong:
        return []
    return [f"{len(wrong)} of {len(evaluations)} evaluation episodes come out otherwise, as {wrong[0]}."]


def _played(env: Any, planned: suite.EvaluationEpisode, actions: Sequence[int]) -> dict[str, Any]:
    """Return what an episode's record says of it, from its seed, start and actions.

    Raises:
        ValueError: If the episode does not end with the last action.
    """
    _, info = env.reset(seed=planned.seed, options=planned.options)
    facts, over = Facts(info), False
    for action in actions:
        if over:
            raise ValueError("there are actions after its end")
        _, reward, terminated, truncated, info = env.step(action)
        facts.add(action, float(reward), info)
        over = terminated or truncated
    if not over:
        raise ValueError("its actions end before the episode does")
    told = facts.report(info)
    names = ("is_success", "final_distance_mm", "final_sin_angle", "steps_to_goal")
    return {"return": told["return_"], **told["poses"], **{name: told[name] for name in names}}


def _same(played: float | None, recorded: float | None, tolerance: float) -> bool:
    """Return whether a record says what was played; None is what never was, which a table holds as NaN."""
    if played is None or recorded is None:
        return played is None and (recorded is None or math.isnan(recorded))
    return abs(played - recorded) <= tolerance


def _number(value: float | None) -> str:
    return "none" if value is None or math.isnan(value) else f"{value:.4f}"


def _tolerance(setting: Setting) -> float:
    return SAME_FROM_FRAMES if setting.guidance.reward_from_frames else SAME
