"""Agents that are released: the same trials give the same bytes, plain arrays act as the trial's model."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
from quick_trials import speed_up
from trials import SMALL

from usbench import cli, records, released
from usbench.checks import ConfigurationError
from usbench.compare import model_card, release
from usbench.results import scores, sources, tables
from usbench.setting import make_env
from usbench.trials import runner
from usbench.trials.configuration import resolve
from usbench.trials.model_loading import load_agent

TRIALS = (
    ("dqn", 0, 0),
    ("double_dqn", 0, 0),
    ("vpg", 0, 0),
    ("vpg", 1, 0),
    ("random", 0, 0),
    ("vpg", 0, 0.5),
)


@pytest.fixture(scope="module")
def all_runs(tmp_path_factory):
    runs = tmp_path_factory.mktemp("runs")
    with pytest.MonkeyPatch.context() as monkeypatch:
        speed_up(monkeypatch)
        for algo, seed, noise in TRIALS:
            steps = None if algo == "random" else 64
            config = resolve(algo, "pp", seed=seed, noise=noise, steps=steps, overrides=SMALL.get(algo))
            runner.run_trial(config, runs)
    return runs


@pytest.fixture
def runs(quick, all_runs):
    """A folder of trials: value-based, the paper's, a reference policy, and one with noise."""
    return all_runs


def contents(folder):
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def could_be_released(runs):
    return [
        trial
        for trial in records.load_trials(runs)
        if not trial.config.noise and trial.config.algo in ("dqn", "double_dqn", "vpg")
    ]


def test_the_same_trials_give_the_same_bytes_and_the_best_of_each_kind(runs, tmp_path):
    told = []
    first = release.write([runs], tmp_path / "one", told.append)
    release.write([runs], tmp_path / "two")
    assert contents(tmp_path / "one") == contents(tmp_path / "two")
    assert [folder.name for folder in first] == ["best-pp", "vpg-pp"]
    scores = {}
    for trial in could_be_released(runs):
        mean = trial.last_evaluation(deterministic=True)["return"].mean()
        scores[trial.name] = trial.anchors.score(mean)
    named = dict(line.split(": ") for line in told)
    papers = [score for name, score in scores.items() if "-vpg-" in name]
    assert scores[named["best:pp"]] == pytest.approx(max(scores.values()))
    assert "-vpg-" in named["vpg:pp"] and scores[named["vpg:pp"]] == pytest.approx(max(papers))


def test_an_agent_that_was_taught_is_the_best_only_where_there_is_no_other(runs):
    trials = sorted(could_be_released(runs), key=lambda trial: trial.name)
    first = release.chosen(trials)["best:pp"]
    taught = replace(first, config=replace(first.config, algo="distilled"))
    others = [trial for trial in trials if trial.name != first.name]
    assert release.chosen([taught, *others])["best:pp"] in others
    assert release.chosen([taught])["best:pp"] is taught


def test_agents_of_other_tasks_stay_and_those_of_the_same_task_are_replaced(runs, tmp_path):
    for name in ("best:fp", "best:pp"):
        shutil.copytree(released.folder_of(name), tmp_path / released.folder_of(name).name)
    shutil.copytree(released.folder_of("best:pp"), tmp_path / "other-pp")
    release.write([runs], tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["best-fp", "best-pp", "vpg-pp"]
    assert contents(tmp_path / "best-fp") == contents(released.folder_of("best:fp"))
    assert contents(tmp_path / "best-pp") != contents(released.folder_of("best:pp"))


def test_plain_arrays_act_as_the_model_of_the_trial(runs, tmp_path):
    env = make_env("pp")
    seen = np.stack([env.reset(seed=seed)[0] for seed in range(8)])
    for trial in could_be_released(runs):
        folder = release.write([trial.folder], tmp_path / trial.name)[0]
        small, large = (load_agent(path).agent.policy.state_dict() for path in (folder, trial.folder))
        # The network that acts: that of double DQN is an average, its target network.
        targets = trial.config.algo == "double_dqn"
        own = [name for name in large if ("target" in name) == targets]
        assert own and all((small[name] == large[name]).all() for name in own)
        assert small.keys() == large.keys()
        first, second = (
            load_agent(path).agent.predict(seen, deterministic=True)[0] for path in (folder, trial.folder)
        )
        assert (first == second).all()
        assert sorted(np.load(folder / records.WEIGHTS, allow_pickle=False).files) == sorted(own)


def test_an_agent_stays_whole_where_its_successor_cannot_be_written(runs, tmp_path, monkeypatch):
    folder = release.write([runs], tmp_path)[0]
    before = contents(tmp_path)
    monkeypatch.setattr(model_card, "text", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        release.write([runs], tmp_path)
    assert folder.name == "best-pp" and contents(tmp_path) == before


def test_of_the_records_the_last_evaluation_is_kept_and_nothing_of_the_machine(runs, tmp_path):
    trial = could_be_released(runs)[0]
    folder = release.write([trial.folder], tmp_path / "made")[0]
    kept = records.Trial.read(folder)
    for greedy in (True, False):
        one, other = (each.last_evaluation(deterministic=greedy) for each in (kept, trial))
        assert one.reset_index(drop=True).equals(other.reset_index(drop=True))
    assert kept.platform == "" and str(tmp_path) not in (folder / records.TRIAL).read_text()


def test_the_command_of_a_card_makes_the_trial(runs, tmp_path, monkeypatch):
    configs = []
    monkeypatch.setattr(runner, "run_trial", lambda config, *_, **__: configs.append(config) or 1 / 0)
    for folder in release.write([runs], tmp_path / "made"):
        card = (folder / released.CARD).read_text().splitlines()
        (line,) = [row for row in card if row.startswith("usbench run")]
        assert cli.main([*line.split()[1:], "--quiet", "--out", str(tmp_path / "runs")]) == 1
        assert configs.pop().folder_name == records.Trial.read(folder).config.folder_name


@pytest.mark.parametrize("senses", [("heading",), ("position", "heading", "actions")])
def test_the_command_of_a_card_says_what_the_agent_is_told(senses, tmp_path, monkeypatch):
    config = resolve("double_dqn", "pp-tracked", seed=3, n_frames=2, senses=senses)
    line = " ".join(model_card.options(config))
    configs = []
    monkeypatch.setattr(runner, "run_trial", lambda config, *_, **__: configs.append(config) or 1 / 0)
    assert cli.main(["run", *line.split(), "--quiet", "--out", str(tmp_path)]) == 1
    assert configs == [config]


def test_a_trial_without_others_is_called_the_one_of_which_the_package_was_made(runs, tmp_path):
    trial = could_be_released(runs)[0]
    folder = release.write([trial.folder], tmp_path / "made")[0]
    assert (
        "\n\nThe package was made from this one trial (seed 0, of the pool for development). The leaderboard "
        "has " in (folder / released.CARD).read_text()
    )


def test_objects_that_could_run_code_are_refused(runs, tmp_path):
    folder = release.write([runs], tmp_path / "made")[0]
    path = folder / records.WEIGHTS
    arrays = dict(np.load(path))
    np.savez(path, **{**arrays, next(iter(arrays)): np.array([print], dtype=object)})
    with pytest.raises(ConfigurationError, match="something else than arrays of numbers"):
        load_agent(folder)
    np.savez(path, **dict(list(arrays.items())[1:]))
    with pytest.raises(ConfigurationError, match="does not fit .*: it has no"):
        load_agent(folder)


def test_trials_that_say_nothing_of_a_task_are_not_released(finished, tmp_path):
    with pytest.raises(ConfigurationError, match="no finished trial to release in .*without noise"):
        release.write([finished], tmp_path / "made")


def test_the_interval_of_a_score_is_that_of_its_mean():
    scores = np.random.default_rng(1).normal(0.8, 0.1, 400)
    low, high = model_card.interval(scores)
    assert low < scores.mean() < high
    assert (high - low) / 2 == pytest.approx(1.96 * 0.1 / np.sqrt(400), rel=0.15)
    assert model_card.interval(np.full(5, 0.7)) == (0.7, 0.7)


def test_a_card_compares_trials_with_those_of_their_own_name_in_the_leaderboard():
    known = tables.read(sources.published())
    final = scores.last(known).set_index("trial")["normalized_score"]
    own = known.trials[(known.trials["task"] == "pp") & (known.trials["noise"] == 0)]
    # The grid's and those with single frames have the same algorithms and seeds.
    assert own[["algo", "seed"]].duplicated().any()
    rivals = [
        model_card.Rival(one.trial, one.algo, one.seed, final[one.trial])
        for one in own[own["steps"] > 0].itertuples()
    ]
    assert model_card._others_again(rivals) == ""
    assert " 1 of them has another score" in model_card._others_again([rivals[0]._replace(score=0.123)])
