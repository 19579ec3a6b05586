"""Data sets: read back by Minari they are what the environment showed, and they say who played."""

import re
from pathlib import Path
from types import SimpleNamespace

import gymnasium as gym
import minari
import numpy as np
import pytest
from quick_trials import DrawnFrames

from usbench import cli, released
from usbench.anchors import Anchors
from usbench.checks import ConfigurationError
from usbench.datasets import card, episodes, minari_files
from usbench.datasets.episodes import Played
from usbench.envs.probe import LinearArray
from usbench.envs.tasks.phantom_distribution import FIRST_HELD_OUT
from usbench.records import Trial
from usbench.setting import Setting


@pytest.fixture
def place(quick, tmp_path, monkeypatch):
    monkeypatch.setenv(minari_files.PLACE, str(tmp_path / "datasets"))
    return tmp_path / "datasets"


PAGE = (Path(__file__).parents[2] / "docs" / "data.md").read_text()


def parts(observations):
    """The arrays of observations (n_steps + 1, ...), by name."""
    return observations if isinstance(observations, dict) else {"": observations}


def test_name_of_the_trial_in_the_present_folder_is_the_folder_s(tmp_path, monkeypatch):
    (tmp_path / "pp-p0-dqn-s0").mkdir()
    monkeypatch.chdir(tmp_path / "pp-p0-dqn-s0")
    assert minari_files.dataset_name(Setting(task="pp"), ".") == "usbench/pp/pp-p0-dqn-s0-v0"


@pytest.mark.parametrize(
    ("task", "agent", "noise"),
    [
        ("pp", "mixed", 0.25),
        ("exam-stop", "oracle", 0.0),
        ("pp-tracked", "random", 0.0),
        ("pp-random", "best", 0.0),
        ("pp-tracked", "mixed", 0.0),
        ("setup-v0", "random", 0.0),
    ],
)
def test_an_episode_played_again_from_its_seed_and_actions_shows_the_same(place, task, agent, noise):
    name, _ = minari_files.write(task, agent, 5, noise=noise, seed=3)
    dataset = minari.load_dataset(name)
    env = dataset.recover_environment()
    assert env.spec.id == Setting(task=task).row.env_id and env.unwrapped.spec.kwargs["noise"] == noise
    assert dataset.observation_space == env.observation_space
    assert dataset.total_episodes == 5 and dataset.total_steps == sum(len(one) for one in dataset)
    for episode in dataset:
        (known,) = dataset.storage.get_episode_metadata([episode.id])
        seen = [env.reset(seed=int(known["seed"]))]
        for k, action in enumerate(episode.actions):
            observation, reward, terminated, truncated, info = env.step(int(action))
            seen.append((observation, info))
            assert reward == episode.rewards[k]
            ended = (bool(episode.terminations[k]), bool(episode.truncations[k]))
            assert ended == (terminated, truncated or (k == len(episode) - 1 and not terminated))
        assert terminated or truncated
        for part, kept in parts(episode.observations).items():
            shown = np.stack([parts(observation)[part] for observation, _ in seen])
            assert kept.dtype == shown.dtype and np.array_equal(kept, shown)
        for fact in ("x_mm", "distance_mm", "is_success"):
            assert list(episode.infos[fact]) == [info[fact] for _, info in seen]


def test_who_plays_in_turn_scores_as_is_known(place):
    name, folder = minari_files.write("pp", "mixed", 30)
    dataset, anchors = minari.load_dataset(name), Setting(task="pp").anchors()
    returns = {number: [] for number in range(3)}
    for episode in dataset:
        (who,) = set(episode.infos["agent"])
        assert who == episode.id % 3
        returns[who].append(episode.rewards.sum())
    oracle, _, rand = (np.mean(own) for own in returns.values())
    assert anchors.score(oracle) > 0.8 and abs(anchors.score(rand)) < 0.2
    assert minari.get_normalized_score(dataset, oracle) == pytest.approx(anchors.score(oracle))
    text = (folder / minari_files.CARD).read_text()
    # A later package may have another best agent.
    best = f"best (`{Trial.read(released.place('best:pp')).config.folder_name}`)"
    for number, agent in enumerate(("oracle", best, "random")):
        mean = np.mean(returns[number])
        assert f"| {number} | {agent} | 10 | {mean:.2f} | {anchors.score(mean):.3f} |" in text


@pytest.mark.parametrize("kept", [True, False])
def test_frames_are_told_of_where_some_are_not_kept(place, monkeypatch, capsys, kept):
    missing = None if kept else Setting(task="pp").guidance.states[-1]
    monkeypatch.setattr(DrawnFrames, "has", lambda _, pose: pose != missing)
    assert cli.main(["dataset", "--task", "pp", "--agent", "random", "--episodes", "1"]) == 0
    assert ("simulating the frames that are not kept yet\n" in capsys.readouterr().err) == (not kept)


def test_the_card_names_the_command_that_makes_the_data_set_again(place):
    _, folder = minari_files.write("pp", "mixed", 2, noise=0.5, seed=3)
    command = "usbench dataset --task pp --agent mixed --episodes 2 --noise 0.5 --seed 3\n"
    assert command in (folder / minari_files.CARD).read_text()


def test_the_command_on_the_card_is_exact(place, finished, tmp_path):
    trial = finished.rename(tmp_path / "my trial")
    _, folder = minari_files.write("pp", str(trial), 1, noise=1 / 3, seed=3)
    command = f"--agent '{trial}' --episodes 1 --noise 0.3333333333333333 --seed 3\n"
    assert command in (folder / minari_files.CARD).read_text()


def test_a_trial_is_called_by_its_name_wherever_it_lies(place, finished, tmp_path):
    trial = finished.rename(tmp_path / "a|b")
    _, folder = minari_files.write("pp", str(trial), 1)
    card = (folder / minari_files.CARD).read_text()
    assert "played by a|b: " in card and r"| 0 | a\|b | 1 |" in card


def test_names_tell_seeds_and_noises_apart():
    names = [
        minari_files.dataset_name(Setting(task="pp", noise=noise), "best", seed)
        for noise in (0.0, 0.25, 0.1234567891, 0.1234567892)
        for seed in (0, 1)
    ]
    assert len(set(names)) == 8
    assert names[:3] == ["usbench/pp/best-v0", "usbench/pp/best-seed1-v0", "usbench/pp/best-noise25-v0"]


def test_episodes_that_no_memory_holds_are_refused(place, capsys, monkeypatch):
    monkeypatch.setattr(minari_files, "memory_bytes", lambda: 1e6)
    assert cli.main(["dataset", "--task", "pp", "--agent", "random", "--episodes", "10"]) == 2
    assert (
        "10 episodes need some 0.0012 GB of memory, and this machine has 0.001 GB" in capsys.readouterr().err
    )
    assert not place.exists()


def test_phantoms_of_evaluations_are_in_no_data_set(place):
    name, _ = minari_files.write("pp-random", "random", 20, seed=3)
    dataset = minari.load_dataset(name)
    env, known = dataset.recover_environment(), dataset.storage.get_episode_metadata(range(20))
    numbers = [env.reset(seed=int(episode["seed"]))[1]["phantom"] for episode in known]
    assert len(set(numbers)) == 20 and max(numbers) < FIRST_HELD_OUT


@pytest.mark.parametrize(("task", "draws"), [("pp", False), ("pp-random", True)])
def test_the_card_says_whether_evaluations_have_its_phantom(task, draws):
    def played(seed, action=0):
        return Played("random", seed, actions=[action], rewards=[0.0], infos={"x_mm": [0], "is_success": [0]})

    setting, anchors = Setting(task=task), Anchors(optimal=0.0, random=-1.0, stay=-1.0)
    text = card.text(task, setting, "random", anchors, [played(1), played(2), played(2, 1)], 0, 1)
    # The same start and the same action twice, in two phantoms where phantoms are drawn.
    assert f"3 episodes, {3 if draws else 2} of them distinct ({'phantom, ' if draws else ''}start" in text
    assert ("Phantoms of evaluations are never in a data set" in text) == draws
    assert ("The phantom is always the same, and evaluations have it, too" in text) == (not draws)


def test_the_same_arguments_give_the_same_episodes_and_another_seed_gives_others(place, tmp_path):
    sets = []
    for number, seed in enumerate((1, 1, 2)):
        out = tmp_path / str(number)
        name, folder = minari_files.write("pp", "random", 4, seed=seed, out=out)
        assert folder == out / name
        with pytest.MonkeyPatch.context() as monkeypatch:
            monkeypatch.setenv(minari_files.PLACE, str(out))
            sets.append([list(episode.actions) for episode in minari.load_dataset(name)])
    assert sets[0] == sets[1] != sets[2]


def test_the_code_of_the_page_reads_a_data_set_in_a_folder_of_ones_own(place, tmp_path, monkeypatch, capsys):
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path)
    argv = ["--task", "pp", "--agent", "best", "--episodes", "2", "--out", "data"]
    assert cli.main(["dataset", *argv]) == 0
    assert f"(with {minari_files.PLACE}={tmp_path / 'data'})" in capsys.readouterr().out
    ((variable, folder),) = re.findall(r'^export (\w+)="\$PWD/(\w+)"$', PAGE, re.MULTILINE)
    monkeypatch.setenv(variable, str(tmp_path / folder))
    monkeypatch.chdir("elsewhere")
    (code,) = re.findall(r"^```python\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE)
    exec(code, names := {})
    assert names["dataset"].total_episodes == 2 and names["env"].spec.id == "usbench/ProbePlane-v0"


def test_a_trial_plays_as_it_does_elsewhere(place, finished):
    name, _ = minari_files.write("pp", str(finished), 3)
    assert name.startswith("usbench/pp/pp-p0-5-vpg-s0-") and minari.load_dataset(name).total_episodes == 3


def test_a_misspelt_agent_is_refused_with_the_one_that_is_meant_and_all_others(place):
    with pytest.raises(ConfigurationError) as refused:
        minari_files.write("pp", "bset", 1)
    known = ", ".join(map(repr, ("oracle", "best", "random", "mixed", *released.names())))
    said = f"unknown agent 'bset' (did you mean 'best'?): allowed are {known}, and the folder of a trial."
    assert str(refused.value) == said


@pytest.mark.parametrize(
    ("trained", "task", "said"),
    [
        ({"task": "pp"}, "fp", "'pp': a data set of 'fp' is played by agents that were trained on 'fp'."),
        (
            {"task": "pp", "probe": LinearArray(n_elements=96)},
            "pp",
            "'pp' with another probe: a data set of 'pp' is played by agents that were trained on 'pp' with "
            "the task's own probe.",
        ),
    ],
)
def test_an_agent_of_something_else_is_refused_with_who_may_play(monkeypatch, trained, task, said):
    loaded = SimpleNamespace(config=None)
    monkeypatch.setattr(episodes, "load_agent", lambda _: loaded)
    monkeypatch.setattr(Setting, "recorded", lambda _: Setting(**trained))
    with pytest.raises(ConfigurationError) as refused:
        episodes.open_agent("vpg:pp", Setting(task=task), 0)
    assert str(refused.value) == f"the agent 'vpg:pp' was trained on {said}"


@pytest.mark.parametrize(
    ("argv", "said"),
    [
        (
            ["--task", "pp", "--agent", "best", "--episodes", "0"],
            "episodes must be a whole number in [1, ",
        ),
        (["--task", "pq", "--agent", "best"], "did you mean"),
        (["--task", "pp", "--agent", "nobody"], "unknown agent 'nobody': allowed are 'oracle', 'best', "),
        (["--task", "pp", "--agent", ""], "unknown agent '': allowed are 'oracle', 'best', "),
        (["--task", "pp", "--agent", "best:fp"], "was trained on 'fp'"),
        (["--task", "setup-v0", "--agent", "best"], "no trained agent 'best:setup-v0'"),
        (["--task", "pp", "--agent", "random", "--noise", "2"], "2"),
        (["--task", "pp", "--agent", "random", "--seed", "-1"], "seed must be a whole number in [0, "),
        (["--task", "pp", "--agent", "random", "--out", __file__], "is a file): choose another"),
        (["--task", "pp", "--agent", "random", "--out", f"{__file__}/below"], "is a file): choose another"),
    ],
)
@pytest.mark.parametrize("installed", [True, False])
def test_what_cannot_be_played_is_refused_in_one_sentence(place, capsys, monkeypatch, argv, said, installed):
    if not installed:  # which is not what is wrong first
        monkeypatch.setattr(minari_files, "find_spec", lambda _: None)
    assert cli.main(["dataset", *argv]) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1
    assert not place.exists()


def test_a_data_set_that_is_there_is_never_overwritten(place, capsys):
    argv = ["dataset", "--task", "pp", "--agent", "random", "--episodes", "2"]
    assert cli.main(argv) == 0
    assert 'minari.load_dataset("usbench/pp/random-v0")' in capsys.readouterr().out
    before = {path: path.read_bytes() for path in place.rglob("*") if path.is_file()}
    assert cli.main(argv) == 2
    assert "there is a data set 'usbench/pp/random-v0'" in capsys.readouterr().err
    assert before == {path: path.read_bytes() for path in place.rglob("*") if path.is_file()}


def test_a_data_set_that_another_process_has_written_meanwhile_stays(place, monkeypatch):
    text = card.text

    def late(*args):
        monkeypatch.setattr(card, "text", text)
        minari_files.write("pp", "random", 2, seed=1)
        return text(*args)

    monkeypatch.setattr(card, "text", late)
    with pytest.raises(ConfigurationError, match="there is a data set 'usbench/pp/random-seed1-v0' in"):
        minari_files.write("pp", "random", 3, seed=1)
    assert minari.load_dataset("usbench/pp/random-seed1-v0").total_episodes == 2


@pytest.mark.filterwarnings("error:.*is out of date")
def test_an_earlier_version_of_a_task_that_is_asked_for_is_no_mistake(place):
    name, _ = minari_files.write("setup-v0", "random", 2)
    assert minari.load_dataset(name).env_spec.id == "usbench/ImagingSetup-v0"


@pytest.mark.parametrize("part", ["_compress", "card.text"])
def test_a_data_set_that_is_broken_off_is_not_there_and_can_be_made_again(place, monkeypatch, part):
    with monkeypatch.context() as broken:
        broken.setattr(f"usbench.datasets.minari_files.{part}", lambda *_: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            minari_files.write("pp", "random", 2)
    assert minari.list_local_datasets() == {}
    assert [path for path in place.rglob("*") if path.is_file()] == []
    name, _ = minari_files.write("pp", "random", 2)
    assert list(minari.list_local_datasets()) == [name]
    assert minari.load_dataset(name).total_episodes == 2


@pytest.mark.parametrize("part", ["episodes.play", "card.text"])
@pytest.mark.parametrize("there", [True, False])
def test_an_interruption_says_what_is_kept_and_leaves_no_empty_folder(
    place, monkeypatch, capsys, part, there
):
    def interrupt(*_):
        raise KeyboardInterrupt

    if there:
        place.mkdir()
    monkeypatch.setattr(f"usbench.datasets.{part}", interrupt)
    assert cli.main(["dataset", "--task", "pp", "--agent", "random", "--episodes", "1"]) == 130
    said = (
        "usbench: interrupted, no data set was written: frames on disk are kept, and the same command plays"
    )
    assert said in capsys.readouterr().err
    # A folder that was empty before is not ours to remove.
    assert place.exists() == there and list(place.parent.glob("datasets/*")) == []


def test_minari_passes_over_what_a_killed_process_left(place):
    left = place / "usbench" / "pp" / ".random-v0.abc.part" / "usbench" / "pp" / "random-v0" / "data"
    left.mkdir(parents=True)
    name, folder = minari_files.write("pp", "random", 2)
    assert list(minari.list_local_datasets()) == [name]
    assert minari.namespace.list_local_namespaces() == ["usbench/pp"]


def test_without_minari_one_sentence_says_what_to_install(place, monkeypatch):
    monkeypatch.setattr("usbench.datasets.minari_files.find_spec", lambda _: None)
    with pytest.raises(ConfigurationError, match=r"pip install 'usbench\[minari\]' \(in a clone"):
        minari_files.write("pp", "random", 1)
    assert not place.exists()


def test_the_environment_is_made_by_gymnasium_alone(place):
    name, _ = minari_files.write("pp", "random", 1)
    assert isinstance(minari.load_dataset(name).recover_environment(), gym.Env)
