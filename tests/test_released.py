"""The trained agents that come with the package: each plays as its card says, and is found by its name."""

import hashlib
import re

import numpy as np
import pandas as pd
import pytest
from fp_frames import FpFrames

import usbench
from usbench import cli, records, released
from usbench.agents import hyperparameters
from usbench.checks import ConfigurationError
from usbench.guide import agents as guide_agents
from usbench.setting import Setting
from usbench.suite import PAPER, TASKS
from usbench.trials.evaluation import Evaluator

LARGEST_BYTES = 8_000_000
NAMES = released.names()
# Only tasks whose focus stays make their frames within seconds.
QUICK = [name for name in NAMES if ":pp" in name]


def test_there_are_agents_for_the_papers_tasks_and_the_best_of_all_others():
    # The first version of `setup` is there for comparisons with older results.
    assert {f"best:{task}" for task in TASKS if task != "setup-v0"} <= set(NAMES)
    assert {f"vpg:{task}" for task in PAPER} <= set(NAMES)


@pytest.mark.parametrize("name", QUICK)
def test_an_agent_plays_as_its_records_and_its_card_say(name):
    plays_as_told(name)


@pytest.mark.parametrize("name", NAMES)
def test_an_agent_acts_on_what_its_task_shows(name):
    loaded = usbench.load_agent(name)
    env = loaded.make_env()
    seen = env.observation_space.sample()
    first, second = (loaded.agent.predict(seen, deterministic=True)[0] for _ in range(2))
    assert env.action_space.contains(int(first)) and first == second
    env.close()


@pytest.mark.parametrize("name", ["best:fp", "vpg:fp"])
def test_an_agent_plays_so_in_the_frames_that_it_was_trained_on(name, monkeypatch):
    frames = FpFrames()
    assert records.Trial.read(released.folder_of(name)).frames.digest == frames.digest()
    monkeypatch.setattr("usbench.envs.guidance.frame_store", lambda *_: frames)
    plays_as_told(name)


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in NAMES if name not in QUICK])
def test_an_agent_plays_so_in_frames_simulated_here(name):
    plays_as_told(name)


def plays_as_told(name):
    loaded, folder = usbench.load_agent(name), released.folder_of(name)
    setting = Setting.recorded(loaded.config)
    evaluator = Evaluator(setting, setting.evaluation_episodes())
    played = evaluator.play(loaded.agent, checkpoint=0, step=0, deterministic=True)
    evaluator.close()
    trial = records.Trial.read(folder)
    score = trial.anchors.score(pd.DataFrame([one.as_row() for one in played])["return"].mean())
    said = re.search(r"\| this agent \| \S+ \| (\S+) \[", (folder / released.CARD).read_text())
    # Another kind of processor rounds otherwise, and may then choose another of two equal actions.
    assert score == pytest.approx(float(said[1]), abs=0.01)
    recorded = trial.last_evaluation(deterministic=True)["return"]
    same = np.isclose([one.as_row()["return"] for one in played], recorded)
    assert same.mean() >= 0.9


@pytest.mark.parametrize("name", NAMES)
def test_a_card_tells_the_digest_of_the_weights(name):
    folder = released.folder_of(name)
    digest = hashlib.sha256((folder / records.WEIGHTS).read_bytes()).hexdigest()
    assert digest in (folder / released.CARD).read_text()


@pytest.mark.parametrize("name", NAMES)
def test_a_card_has_the_hyperparameters_as_the_command_takes_them(name):
    folder = released.folder_of(name)
    said = re.search(
        r"^Hyperparameters: (.+?)\. Versions: ", (folder / released.CARD).read_text(), re.MULTILINE
    )
    pairs = [one.split("=") for one in said[1].split(", ")]
    own = records.Trial.read(folder).config.hyperparameters
    assert {key: hyperparameters.parse(key, value) for key, value in pairs} == own


def test_all_agents_together_are_small():
    files = [path for path in released.FOLDER.rglob("*") if path.is_file()]
    assert sum(path.stat().st_size for path in files) < LARGEST_BYTES


def test_a_name_without_an_agent_is_refused_with_the_names_that_there_are(capsys):
    with pytest.raises(
        ConfigurationError, match=r"no trained agent 'best:nothing' .*: there are best:exam, "
    ):
        usbench.load_agent("best:nothing")
    assert cli.main(["watch", "best:nothing"]) == 2
    error = capsys.readouterr().err
    assert "there are best:exam, " in error and error.count("\n") == 1
    with pytest.raises(ConfigurationError, match="there are best:exam, "):
        guide_agents.known("best:nothing")


def test_a_misspelt_name_is_refused_with_the_name_that_was_meant(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for misspelt in ("bst:pp", "best:ppp", "Best:pp"):
        with pytest.raises(
            ConfigurationError, match=rf"no trained agent '{misspelt}' \(did you mean 'best:pp'"
        ):
            usbench.load_agent(misspelt)


def test_a_name_without_its_task_is_refused_with_all_names_unless_it_is_a_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ConfigurationError, match="there is no folder 'best'; agents .* best:exam, "):
        released.place("best")
    (tmp_path / "best").mkdir()
    assert released.place("best").resolve() == tmp_path / "best"


def test_the_guide_refuses_an_agent_of_a_task_that_it_does_not_show():
    with pytest.raises(ConfigurationError, match=r"^'best:setup' is of the task 'setup': the guide shows"):
        guide_agents.known("best:setup")


def test_a_card_names_the_guide_where_it_shows_the_task():
    for name in NAMES:
        card = (released.folder_of(name) / released.CARD).read_text()
        assert (f"`usbench guide {name}`" in card) == (name.split(":")[1] in guide_agents.GUIDED)


def test_a_folder_of_that_name_comes_first(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "best:pp").mkdir()
    assert released.place("best:pp").resolve() == tmp_path / "best:pp"


def test_an_agent_is_watched_by_its_name(capsys):
    assert cli.main(["watch", "best:pp", "--episode", "0"]) == 0
    assert "evaluation episode 0" in capsys.readouterr().out


def test_the_guide_offers_the_agents_and_begins_with_the_best(tmp_path):
    found = guide_agents.find(tmp_path)
    assert {one.name for one in found} == {
        name for name in NAMES if name.split(":")[1] in guide_agents.GUIDED
    }
    best = guide_agents.best(found, Setting(task="pp"))
    assert best.is_released and best.score == max(one.score for one in found if one.task == "pp")
