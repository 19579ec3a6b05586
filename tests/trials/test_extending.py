"""Algorithms from outside: what docs/extending.md shows, run as a user runs it."""

import re
import sys
from dataclasses import replace
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest
from state_files import read_state

from usbench import cli, records
from usbench.agents import plugins, zoo
from usbench.agents.rows.entry import NEEDS, Entry
from usbench.envs.pose import Pose
from usbench.envs.tasks.examination import EXAMINATION
from usbench.records import checksums
from usbench.setting import Setting
from usbench.trials import knowledge
from usbench.trials.configuration import resolve
from usbench.trials.model_loading import load_agent
from usbench.trials.runner import run_trial

PAGE = Path(__file__).parents[2] / "docs" / "extending.md"
SHORT = ["--task", "pp", "--steps", "64", "--quiet"]


@pytest.fixture
def here(quick, monkeypatch, tmp_path):
    """A folder with the page's mine.py."""
    code = re.search(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)[1]
    (tmp_path / "mine.py").write_text(code)
    monkeypatch.chdir(tmp_path)
    yield tmp_path
    sys.modules.pop("mine", None)


def the_code(part):
    """The page's only Python block that holds `part`."""
    (code,) = (
        code for code in re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL) if part in code
    )
    return code


LATE = """
class Late(Counter):
    learned = 0

    def learn(self, total_timesteps):
        super().learn(total_timesteps)
        self.learned = 3

    def predict(self, observations, *_, **__):
        return np.full(len(observations), self.learned), None
"""
IMPATIENT = """
class Impatient(Counter):
    def learn(self, total_timesteps):
        for step in range(total_timesteps):
            if step % 24 == 0:
                self.env.reset()
            self.env.step([0])
"""


def add(here, code):
    """Add a class to the page's mine.py."""
    with (here / "mine.py").open("a") as file:
        file.write(f"\n{code}")


def the_trial(here):
    (folder,) = records.trial_folders(here / "runs")
    return folder


def test_an_algorithm_that_refuses_the_environment_is_refused_before_any_frame(tmp_path, monkeypatch, caplog):
    monkeypatch.setattr(Setting, "prepare_frames", lambda *_: pytest.fail("frames were simulated"))
    config = resolve("stable_baselines3:SAC", "pp", steps=64)
    with pytest.raises(records.TrialError, match=r"failed: AssertionError: .* Discrete\(5\) was provided"):
        run_trial(config, tmp_path, rehearse=True)
    assert not caplog.records
    (folder,) = records.trial_folders(tmp_path)
    assert records.Trial.read(folder).status == "failed"


def test_the_pages_classes_are_short():
    code = re.search(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)[1]
    assert code.count("\n") < 30


def test_the_pages_task_is_the_examination():
    shown = {}
    exec(the_code("EXAMINATION = Task("), shown)
    functions = {name: getattr(EXAMINATION, name) for name in ("reward", "is_success", "distance_mm")}
    assert replace(shown["EXAMINATION"], **functions) == EXAMINATION
    here, there = Pose(5, 35, 30), Pose(-10, 50, 0)
    for name, function in functions.items():
        kinds = [("normalized",), ("paper",)] if name == "reward" else [()]
        for kind in kinds:
            assert shown[name](here, there, *kind) == function(here, there, *kind)


def test_a_class_without_stable_baselines_is_a_trial_like_any_other(here):
    assert cli.main(["run", "--algo", "mine:Counter", *SHORT]) == 0
    folder = the_trial(here)
    assert ":" not in folder.name
    # Two checkpoints after the one before training; all are evaluated, both ways.
    assert sorted(set(records.load(folder)["checkpoint"])) == [0, 32, 64]
    assert len(records.load(folder, "episodes")) == 64 // 16


def test_an_algorithm_that_ends_the_program_fails_its_trial_and_no_other(here, monkeypatch):
    monkeypatch.syspath_prepend(here)
    with (here / "mine.py").open("a") as file:
        file.write("\n\nclass Ending(Counter):\n    def learn(self, *_, **__):\n        sys.exit('enough')\n")
        file.write("\nimport sys\n")
    with pytest.raises(records.TrialError, match="failed: SystemExit: enough"):
        run_trial(resolve("mine:Ending", "pp", steps=16), here / "runs")
    state = read_state(the_trial(here))
    assert (state["status"], state["reason"]) == ("failed", "SystemExit: enough")


def test_an_algorithm_that_ends_the_program_as_it_is_saved_leaves_a_finished_trial(here, monkeypatch):
    monkeypatch.syspath_prepend(here)
    folder, left = run_saving(here, "import sys; sys.exit('enough')")
    assert not left and read_state(folder)["status"] == "finished"


def test_starts_and_noise_are_those_of_other_algorithms(here):
    for algo in ("mine:Counter", "a2c"):
        assert cli.main(["run", "--algo", algo, *SHORT, "--out", algo[:4]]) == 0
    starts = [
        records.load(here / out, "episodes").filter(like="start_").to_numpy().tolist()
        for out in ("mine", "a2c")
    ]
    assert starts[0] == starts[1]


def test_a_row_of_ones_own_and_settings(here):
    argv = ["run", "--algo", "mine:LongPPO", *SHORT, "--set", "n_steps=64", "batch_size=64", "gamma=0.5"]
    assert cli.main(argv) == 0
    chosen = read_state(the_trial(here))["config"]["hyperparameters"]
    assert (chosen["n_epochs"], chosen["gamma"]) == (8, 0.5)


def test_a_stable_baselines_class_gets_the_network_of_all_others():
    row = zoo.entry("stable_baselines3:PPO")
    assert row.policy_kwargs == zoo.ZOO["ppo"].policy_kwargs
    assert zoo.entry("stable_baselines3:DQN").policy_kwargs == zoo.ZOO["dqn"].policy_kwargs


def test_the_pages_network_learns_from_stacked_frames(here):
    (here / "network.py").write_text(the_code("NatureCNN"))
    argv = ["run", "--algo", "network:NaturePPO", *SHORT, "--set", "n_steps=32", "batch_size=32"]
    try:
        assert cli.main(argv) == 0
        agent = load_agent(the_trial(here), algo="network:NaturePPO").agent
        assert type(agent.policy.pi_features_extractor).__name__ == "Nature"
        assert agent.policy.pi_features_extractor.features_dim == 128
    finally:
        sys.modules.pop("network", None)


CLIPPED = """
from dataclasses import replace

from usbench.agents.zoo import ZOO

ppo = ZOO["ppo"]
own = {**ppo.hyperparameters, "n_steps": 32, "batch_size": 32, "clip_range_vf": 0.2}
Clipped = replace(ppo, hyperparameters=own, presets={"wide": {"clip_range_vf": 0.5}})
"""


@pytest.mark.parametrize(("options", "clip"), [([], 0.2), (["--preset", "wide"], 0.5)])
def test_a_row_with_a_hyperparameter_that_cannot_be_set_is_opened_with_its_own_value(here, options, clip):
    (here / "mine.py").write_text(CLIPPED)
    assert cli.main(["run", "--algo", "mine:Clipped", *SHORT, *options]) == 0
    agent = load_agent(the_trial(here), algo="mine:Clipped").agent
    assert agent.clip_range_vf(1.0) == clip
    with pytest.raises(ValueError, match="unknown hyperparameter of mine:Clipped 'clip_range_vf'"):
        zoo.hyperparameters("mine:Clipped", "pp", {"clip_range_vf": 0.3})


def test_what_cannot_be_set_is_listed_apart(here, capsys):
    (here / "mine.py").write_text(CLIPPED)
    assert cli.main(["list", "mine:Clipped"]) == 0
    can, cannot = capsys.readouterr().out.split("fixed")
    assert "clip_range=" in can and "clip_range_vf" not in can and "clip_range_vf=0.2" in cannot


WHOLE_EPISODES = """
from stable_baselines3 import DQN

class Whole(DQN):
    def __init__(self, *args, **kwargs):
        super().__init__(*args, **kwargs, train_freq=(1, "episode"), learning_starts=8, buffer_size=100)
"""


def test_an_agent_that_learns_after_whole_episodes_keeps_the_budget(here):
    (here / "mine.py").write_text(WHOLE_EPISODES)
    assert cli.main(["run", "--algo", "mine:Whole", "--task", "pp", "--steps", "40", "--quiet"]) == 0
    assert records.load(here / "runs", "evaluations")["step"].max() == 40


def test_a_model_that_is_not_stable_baselines_is_not_opened(here):
    assert cli.main(["run", "--algo", "mine:Counter", *SHORT]) == 0
    said = "a model of mine:Counter cannot be opened safely: .*; open it with the code that saved it"
    with pytest.raises(records.ConfigurationError, match=said):
        load_agent(the_trial(here), algo="mine:Counter")


def test_a_trial_of_a_class_from_outside_is_watched_without_advice_and_not_guided(here, capsys):
    assert cli.main(["run", "--algo", "mine:Counter", *SHORT]) == 0
    trial, sys.modules["mine"] = str(the_trial(here)), None  # importing it raises an error
    capsys.readouterr()
    assert cli.main(["watch", trial]) == 0
    shown = capsys.readouterr()
    why = (
        "asking the agent would run the code of 'mine:Counter', which is not of this package; what it did is"
    )
    assert shown.err.startswith(f"without advice: {why} shown") and "greedy" in shown.out
    assert cli.main(["guide", trial, "--no-browser"]) == 2
    shown = capsys.readouterr()
    assert shown.out == "" and "cannot advise: asking it would run the code of 'mine:Counter'" in shown.err


def test_all_that_a_row_may_need_is_known():
    assert set(NEEDS) == set(knowledge.NEEDS)


@pytest.mark.parametrize("need", ["teachers", "anchors"])
def test_a_row_that_needs_what_no_task_gives_is_refused(need):
    with pytest.raises(ValueError, match=f"unknown need of an algorithm '{need}'"):
        Entry("mine:Counter", needs=need)


def test_entry_point_gives_a_plain_name(here, monkeypatch, capsys):
    point = EntryPoint("counter", "mine:Counter", plugins.GROUP)
    monkeypatch.setattr(plugins, "entry_points", lambda group: [point] if group == plugins.GROUP else [])
    assert cli.main(["list"]) == 0
    assert "mine:Counter" in capsys.readouterr().out
    assert cli.main(["run", "--algo", "counter", *SHORT]) == 0
    assert "-counter-s0-" in the_trial(here).name
    assert cli.main(["run", "--algo", "countr", *SHORT]) == 2
    assert "'counter'" in capsys.readouterr().err


@pytest.mark.parametrize("names", [("dqn",), ("counter", "counter")])
def test_a_name_that_exists_already_is_refused(monkeypatch, capsys, names):
    points = [EntryPoint(name, f"mine{number}:Counter", plugins.GROUP) for number, name in enumerate(names)]
    monkeypatch.setattr(plugins, "entry_points", lambda group: points if group == plugins.GROUP else [])
    assert cli.main(["list"]) == 2
    shown = capsys.readouterr().err
    assert f"a package with {points[-1].value!r} brings an algorithm {names[0]!r}, which exists" in shown


SAVING = """

class Saving(Counter):
    def save(self, path):
        {saves}
"""


def run_saving(here, saves):
    """The folder of a finished trial of an agent that saves so, and the files of its model."""
    with (here / "mine.py").open("a") as file:
        file.write(SAVING.format(saves=saves))
    folder = run_trial(resolve("mine:Saving", "pp", steps=16), here / "runs").folder
    of_trial = {records.TRIAL, records.EPISODES, records.EVALUATIONS}
    return folder, {path.name for path in folder.iterdir()} - of_trial


@pytest.mark.parametrize(
    ("saves", "name"),
    [
        ("np.savez(path, weights=np.arange(3))", "model.zip.npz"),
        ("path.with_name('model.zip.zip').write_bytes(b'weights')", "model.zip.zip"),
        ("path.mkdir(); (path / 'weights').write_bytes(b'0')", "model.zip"),
    ],
)
def test_model_is_kept_whatever_suffix_its_save_adds(here, monkeypatch, saves, name):
    monkeypatch.syspath_prepend(here)
    folder, files = run_saving(here, saves)
    assert files == {name}
    kept = folder / name
    assert any(kept.iterdir()) if kept.is_dir() else kept.stat().st_size > 0


def test_records_of_an_agent_that_cannot_be_saved_are_kept(here, monkeypatch, caplog):
    monkeypatch.syspath_prepend(here)
    folder, files = run_saving(here, "path.write_bytes(b'half'); raise TypeError('no\\nway')")
    assert files == set()
    assert read_state(folder)["status"] == "finished" and len(records.load(folder, "episodes")) == 1
    assert f"the trial {folder.name} has no model: Saving.save failed (TypeError: no way)" in caplog.text
    # Nothing is trained again.
    assert run_trial(resolve("mine:Saving", "pp", steps=16), here / "runs").skipped


def test_a_finished_trial_whose_code_has_changed_since_is_shown_with_a_warning(here, capsys):
    run = ["run", "--algo", "mine:Counter", *SHORT]
    assert cli.main(run) == 0 and cli.main(run) == 0
    assert "finished already" in capsys.readouterr().out
    with (here / "mine.py").open("a") as file:
        file.write("\n\nSTEP = 2\n")
    assert cli.main(run) == 0
    said = "This trial is finished, but its algorithm's code has changed since: --overwrite runs it again."
    assert said in capsys.readouterr().out.splitlines()
    assert cli.main([*run, "--overwrite"]) == 0 and cli.main(run) == 0
    assert said not in capsys.readouterr().out.splitlines()


def test_a_row_whose_own_network_has_changed_is_other_code(here, monkeypatch):
    monkeypatch.syspath_prepend(here)
    (here / "network.py").write_text(the_code("class Nature"))
    found = zoo.modules("network:NaturePPO")
    assert found == ["network", "usbench.agents.on_policy"]
    before = checksums.of_modules(found)
    (here / "network.py").write_text(the_code("class Nature").replace("features_dim=128", "features_dim=32"))
    assert before != checksums.of_modules(found) != ""
    sys.modules.pop("network")


def test_what_is_learned_after_the_last_step_is_evaluated(here, monkeypatch):
    monkeypatch.syspath_prepend(here)
    add(here, LATE)
    folder = run_trial(resolve("mine:Late", "pp", steps=64), here / "runs").folder
    played = records.load(folder)
    actions = {step: {str(own) for own in rows["actions"]} for step, rows in played.groupby("step")}
    assert actions[64] == {str(played["actions"].iloc[-1])} and actions[64].isdisjoint(actions[32])


def test_steps_are_counted_where_an_agent_begins_episodes_by_itself(here, monkeypatch):
    monkeypatch.syspath_prepend(here)
    add(here, IMPATIENT)
    folder = run_trial(resolve("mine:Impatient", "pp", steps=96), here / "runs").folder
    assert list(records.load(folder, "episodes")["step"]) == [16, 40, 64, 88]


def test_a_save_that_finds_no_folder_costs_the_model_alone(here, monkeypatch, caplog):
    monkeypatch.syspath_prepend(here)
    folder, files = run_saving(here, "np.save(path / 'sums.npy', np.arange(3))")
    assert files == set() and read_state(folder)["status"] == "finished"
    assert "Saving.save failed (FileNotFoundError" in caplog.text


@pytest.mark.parametrize("logger", ["None", "logging.getLogger('mine')"])
def test_agent_has_the_logger_that_it_likes(here, monkeypatch, logger):
    monkeypatch.syspath_prepend(here)
    with (here / "mine.py").open("a") as file:
        file.write(f"\n\nimport logging\n\n\nclass Logging(Counter):\n    logger = {logger}\n")
    folder = run_trial(resolve("mine:Logging", "pp", steps=16), here / "runs").folder
    assert read_state(folder)["status"] == "finished"


def test_trial_that_ends_early_says_why_also_where_its_agent_cannot_be_saved(here, capsys, caplog):
    text = (here / "mine.py").read_text().replace("(total_timesteps):\n            a", "(40):\n            a")
    (here / "mine.py").write_text(text + SAVING.format(saves="raise TypeError('no way')"))
    assert cli.main(["run", "--algo", "mine:Saving", *SHORT]) == 1
    assert "made 40 training steps instead of 64" in capsys.readouterr().err
    assert "Saving.save failed" in caplog.text
    assert read_state(the_trial(here))["status"] == "failed"


def test_steps_that_are_not_the_budget_fail_the_trial(here, capsys):
    (here / "mine.py").write_text(
        (here / "mine.py").read_text().replace("(total_timesteps):\n            a", "(40):\n            a")
    )
    assert cli.main(["run", "--algo", "mine:Counter", *SHORT]) == 1
    assert "made 40 training steps instead of 64" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("algo", "said"),
    [
        ("mine:Missing", "Missing"),
        ("nowhere:Counter", "No module named 'nowhere'"),
        ("mine:", "module:name"),
        ("mine.py", "module:name, as mine:Counter in mine.py, not 'mine.py'"),
        ("./mine.py", "module:name"),
        ("mine.py:Counter", "module:name"),
        ("mine:Counter:x", "module:name"),
        ("mine:np", "learn and predict"),
        ("pathlib:Path", "learn and predict"),
    ],
)
def test_what_is_no_algorithm_is_refused_in_one_sentence(here, capsys, algo, said):
    assert cli.main(["run", "--algo", algo, *SHORT]) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1


@pytest.mark.parametrize(
    ("row", "said"),
    [
        ("hyperparameters={'batch_size': 0}", "batch_size must be a whole number in ["),
        ("hyperparameters={'batch_size': None}", "batch_size must be a whole number in ["),
        ("hyperparameters={'n_steps': -256}", "n_steps must be a whole number in ["),
        ("hyperparameters={'learning_rate': '1e-3'}", "learning_rate must be a number in (0, 1]"),
        ("cls='nowhere:X'", "'nowhere:X' cannot be imported (ModuleNotFoundError"),
    ],
)
def test_row_of_ones_own_that_cannot_be_is_refused_in_one_sentence(here, capsys, row, said):
    code = "from dataclasses import replace\nfrom usbench.agents.zoo import ZOO\n"
    (here / "mine.py").write_text(f"{code}Row = replace(ZOO['ppo'], {row})\n")
    assert cli.main(["run", "--algo", "mine:Row", *SHORT]) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1


def test_module_that_ends_the_program_is_refused_in_one_sentence(here, capsys):
    (here / "quits.py").write_text("import sys\n\nsys.exit()\n")
    assert cli.main(["run", "--algo", "quits:Agent", *SHORT]) == 2
    error = capsys.readouterr().err
    assert "'quits:Agent' cannot be imported (SystemExit" in error and error.count("\n") == 1


def test_broken_module_is_refused_in_one_sentence(here, capsys):
    (here / "broken.py").write_text("1 / 0\n")
    assert cli.main(["run", "--algo", "broken:Agent", *SHORT]) == 2
    assert "ZeroDivisionError" in capsys.readouterr().err
