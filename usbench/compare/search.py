"""A search for hyperparameters: candidates from Optuna, trials from the sweep, a table at the end.

A search that is killed and started again ends with the same table: what was begun stands in Optuna's journal,
what was trained in the trials' records, and the candidates of a batch follow from those before it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from usbench import records, suite
from usbench.agents.search_space import SPACES, Choice, Log
from usbench.agents.zoo import hyperparameters
from usbench.atomic import atomic_file
from usbench.checks import unknown
from usbench.compare import sweep
from usbench.compare.plan import positive
from usbench.records import ConfigurationError, Trial, TrialConfig
from usbench.trials.configuration import resolve

# Comparisons count their seeds from 0. Finalists have others than those that chose them.
FIRST_SEED, FINAL_SEED = 1000, 1100
FINAL_SEEDS = 2
# Candidates at a time, whatever the number of cores: they must not depend on it.
BATCH = 4


@dataclass(frozen=True)
class Settings:
    """What a candidate is judged by: its mean score over tasks and seeds after the last step."""

    algo: str
    tasks: tuple[str, ...]
    noise: float
    seeds: int
    steps: int
    first_seed: int = FIRST_SEED

    @property
    def finals(self) -> "Settings":
        """What finalists are judged by: the paper's tasks with their whole budget, and more seeds."""
        steps = suite.TASKS[suite.PAPER[0]].steps
        return replace(self, tasks=suite.PAPER, seeds=FINAL_SEEDS, steps=steps, first_seed=FINAL_SEED)

    @property
    def folder_name(self) -> str:
        """Name of the search's folder: trials, journal and table."""
        return f"search-{self.algo}-{'-'.join(self.tasks)}-p{self.noise:g}-{self.seeds}x{self.steps}"

    def trials(self, params: dict[str, Any]) -> list[TrialConfig]:
        """Return the trials of the candidate `params`."""
        return [
            resolve(
                self.algo,
                task,
                noise=self.noise,
                seed=self.first_seed + seed,
                steps=self.steps,
                overrides=params,
            )
            for seed in range(self.seeds)
            for task in self.tasks
        ]


def settings_of(algo: str, tasks: Sequence[str], *, seeds: Any, **asked: Any) -> Settings:
    """Return checked settings; `asked` holds what `resolve` takes: `noise`, `steps`.

    Raises:
        ConfigurationError: If a name is unknown or a value is not allowed; one sentence says which.
    """
    if algo not in SPACES:
        raise ConfigurationError(str(unknown("algorithm with a search space", algo, SPACES)))
    configs = [resolve(algo, task, **asked) for task in dict.fromkeys(tasks)]
    if len({config.steps for config in configs}) > 1:
        raise ConfigurationError(
            f"the tasks {', '.join(tasks)} have different budgets: say how many steps to train on each."
        )
    names = tuple(config.task for config in configs)
    if unseen := [name for name in names if suite.TASKS[name].phantoms]:
        raise ConfigurationError(
            f"{unseen[0]} is evaluated on the phantoms that comparisons test with, which must not choose "
            f"hyperparameters: search on {suite.TASKS[unseen[0]].single}."
        )
    return Settings(algo, names, configs[0].noise, positive("seeds", seeds), configs[0].steps)


def run(
    settings: Settings,
    n_candidates: int,
    out: Path,
    progress: sweep.Progress,
    n_finalists: int = 0,
    **kwargs: Any,
) -> Path:
    """Try candidates until there are `n_candidates`, then the best `n_finalists` again by `settings.finals`.

    Returns the path of the table. `kwargs` go to the sweep. The first candidate is the algorithm's defaults.

    Raises:
        ConfigurationError: If Optuna is not installed, `out` cannot be written, or finalists are asked for
            in a search on other tasks.
        KeyboardInterrupt: After the running trials have kept their state.
    """
    if n_finalists and not set(settings.tasks) <= set(suite.PAPER):
        raise ConfigurationError(
            f"finalists are judged on {' and '.join(suite.PAPER)}, which is no final of a search on "
            f"{', '.join(settings.tasks)}: ask for no finalists."
        )
    folder = out / settings.folder_name
    study = _study(settings, out)
    while batch := _batch(study, settings, n_candidates):
        for number, score in _judged(batch, settings, folder, progress, **kwargs).items():
            study.tell(number, score, state=_state("FAIL" if score is None else "COMPLETE"))
    ended = study.get_trials(deepcopy=False, states=(_state("COMPLETE"), _state("FAIL")))
    scores = {trial.number: trial.value for trial in ended}
    ended = _best_first(ended, scores)
    text = f"# Search for `{settings.algo}`\n\n" + _table(ended, scores, settings, folder)
    if n_finalists:
        finalists = [trial for trial in ended if trial.value is not None][:n_finalists]
        scores = _judged(finalists, settings.finals, folder, progress, **kwargs)
        finalists = _best_first(finalists, scores)
        text += "\n## The best of them again\n\n" + _table(finalists, scores, settings.finals, folder)
    path = folder / "search.md"
    with atomic_file(path) as file:
        file.write(text.encode())
    return path


def _best_first(candidates: Sequence[Any], scores: Mapping[int, float | None]) -> list[Any]:
    """Return the candidates by their scores, those that failed at the end."""
    return sorted(candidates, key=lambda one: (scores[one.number] is None, -(scores[one.number] or 0.0)))


def _judged(
    candidates: Sequence[Any], settings: Settings, folder: Path, progress: sweep.Progress, **kwargs: Any
) -> dict[int, float | None]:
    """Run what is missing of the candidates' trials; return their scores by number, None where one failed."""
    trials = {candidate.number: settings.trials(candidate.params) for candidate in candidates}
    outcomes = sweep.run([one for each in trials.values() for one in each], folder, progress, **kwargs)
    failed = {outcome.config.folder_name for outcome in outcomes if outcome.reason is not None}
    return {
        number: None if any(config.folder_name in failed for config in own) else _mean(own, folder)
        for number, own in trials.items()
    }


def _study(settings: Settings, out: Path) -> Any:
    try:
        import optuna
        from optuna.storages import JournalStorage
        from optuna.storages.journal import JournalFileBackend
    except ImportError:
        raise ConfigurationError("a search needs Optuna: pip install 'usbench[search]'.") from None
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    folder = out / settings.folder_name
    try:
        folder.mkdir(parents=True, exist_ok=True)
        storage = JournalStorage(JournalFileBackend(str(folder / "study.journal")))
    except OSError as error:
        raise records.unwritable(out, error) from error
    study = optuna.create_study(
        storage=storage, study_name=settings.algo, direction="maximize", load_if_exists=True
    )
    defaults = hyperparameters(settings.algo, settings.tasks[0])
    if not study.trials:
        study.enqueue_trial({name: defaults[name] for name in SPACES[settings.algo]})
    return study


def _batch(study: Any, settings: Settings, n_candidates: int) -> list[Any]:
    """Return the candidates that have begun and have no score, and new ones up to BATCH or `n_candidates`."""
    import optuna

    running = list(study.get_trials(deepcopy=False, states=(_state("RUNNING"),)))
    n_begun = sum(trial.state != _state("WAITING") for trial in study.get_trials(deepcopy=False))
    # A batch that a kill left half asked for is filled up: the same candidates as without it.
    n_batches = -(-n_begun // BATCH) if running else n_begun // BATCH + 1
    for number in range(n_begun, min(n_batches * BATCH, n_candidates)):
        # A new sampler for each, so that a candidate does not depend on how the one before was chosen.
        study.sampler = optuna.samplers.TPESampler(seed=number, n_startup_trials=8, constant_liar=True)
        running.append(study.ask(_distributions(settings.algo)))
    return running


def _distributions(algo: str) -> dict[str, Any]:
    from optuna.distributions import CategoricalDistribution, FloatDistribution

    kinds: dict[str, Any] = {}
    for name, space in SPACES[algo].items():
        match space:
            case Log(low, high):
                kinds[name] = FloatDistribution(low, high, log=True)
            case Choice(values):
                kinds[name] = CategoricalDistribution(values)
    return kinds


def _state(name: str) -> Any:
    from optuna.trial import TrialState

    return TrialState[name]


def _mean(configs: Sequence[TrialConfig], folder: Path) -> float:
    """Return the mean normalised score with greedy actions after the last step, as the leaderboard does."""
    scores = []
    for config in configs:
        last = Trial.read(folder / config.folder_name).last_evaluation(deterministic=True)
        scores.append(float(last["normalized_score"].mean()))
    return sum(scores) / len(scores)


def _table(
    candidates: Sequence[Any], scores: Mapping[int, float | None], settings: Settings, folder: Path
) -> str:
    """Return the candidates, in this order, as Markdown."""
    rows = []
    for candidate in candidates:
        configs, score = settings.trials(candidate.params), scores[candidate.number]
        row = {"candidate": candidate.number, "score": score}
        for task in settings.tasks if score is not None else ():
            row[task] = _mean([config for config in configs if config.task == task], folder)
        rows.append(row | candidate.params)
    columns = ["candidate", "score", *settings.tasks, *SPACES[settings.algo]]
    lines = [columns, ["---"] * len(columns)]
    lines += [[_text(row.get(name)) for name in columns] for row in rows]
    first, last = settings.first_seed, settings.first_seed + settings.seeds - 1
    seeds = f"seed {first}" if first == last else f"seeds {first} to {last}"
    return (
        f"{len(rows)} candidates on {' and '.join(settings.tasks)}, noise {settings.noise:g}, "
        f"{settings.steps} steps, {seeds} (no comparison uses them). The score is the mean over tasks and "
        "seeds of the normalised score with greedy actions after the last step. Candidate 0 has the "
        "defaults.\n\n" + "".join(f"| {' | '.join(line)} |\n" for line in lines)
    )


def _text(value: object) -> str:
    if value is None:
        return "failed"
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:.3g}" if isinstance(value, float) else str(value)
