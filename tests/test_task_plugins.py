"""Tasks of other packages, found by their entry point: trained like any other, or refused in one sentence."""

import os
import re
import subprocess
import sys
import textwrap
from dataclasses import replace
from pathlib import Path

import pytest
from state_files import read_state, write_state

from usbench import cli, records, suite, tasks
from usbench.setting import Setting

PAGE = Path(__file__).parents[1] / "docs" / "extending.md"

MODULE = """
from dataclasses import replace

from usbench.envs.tasks.probe_plane import PROBE_PLANE, ProbePlaneEnv
from usbench.tasks import Row

PLAIN = Row(env_id="other/Upright-v0", entry_point="other_tasks:UprightEnv", steps=64)
TAKEN = replace(PLAIN, env_id="usbench/ProbePlane-v0")


class UprightEnv(ProbePlaneEnv):
    "The probe plane with one start."

    task = replace(PROBE_PLANE, name="upright", title="Upright", starts=PROBE_PLANE.starts[:1])
"""


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """`installed("name = module:object", ..)`: packages with such entry points, as pip leaves them."""

    def install(*points, module=MODULE):
        (tmp_path / "other_tasks.py").write_text(textwrap.dedent(module))
        for number, point in enumerate(points):
            info = tmp_path / f"other{number}-1.0.dist-info"
            info.mkdir()
            (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: other{number}\nVersion: 1.0\n")
            (info / "entry_points.txt").write_text(f"[usbench.tasks]\n{point}\n")
        monkeypatch.syspath_prepend(str(tmp_path))
        tasks.rows.cache_clear()

    yield install
    sys.modules.pop("other_tasks", None)
    tasks.rows.cache_clear()


def test_its_row_is_beside_those_of_the_package(installed):
    installed("upright = other_tasks:PLAIN")
    assert list(tasks.rows())[-1] == "upright" and tasks.row_of("upright").steps == 64


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (["upright = nowhere:ROW"], "the task 'upright' of the package 'other0' cannot be imported (Module"),
        (["upright = other_tasks:MISSING"], "cannot be imported (AttributeError"),
        (["upright = other_tasks:UprightEnv"], "must be a usbench.tasks.Row"),
        (["pp = other_tasks:PLAIN"], "'other0' brings a task 'pp', which exists already"),
        (["up = other_tasks:PLAIN", "up = other_tasks:PLAIN"], "brings a task 'up', which exists already"),
        (
            ["up = other_tasks:PLAIN", "again = other_tasks:PLAIN"],
            "Gymnasium id of another, 'other/Upright-v0'",
        ),
        (["taken = other_tasks:TAKEN"], "Gymnasium id of another, 'usbench/ProbePlane-v0'"),
    ],
)
def test_a_package_whose_task_cannot_be_used_is_refused(installed, points, message):
    installed(*points)
    with pytest.raises(records.ConfigurationError) as refused:
        tasks.rows()
    assert message in str(refused.value) and "\n" not in str(refused.value)


@pytest.mark.parametrize("place", ["my_task.py", "./my_task.py", "my_task:Env", "my_task.Env", "mine/Env-v0"])
def test_a_file_or_class_in_place_of_a_task_is_told_what_names_a_task(place):
    with pytest.raises(records.ConfigurationError) as refused:
        Setting(task=place)
    told = str(refused.value)
    assert told.startswith(f"unknown task {place!r}") and ": allowed are 'fp', " in told
    said = (
        "; a task of your own is named by an entry point of the group 'usbench.tasks' in an installed package"
    )
    assert told.endswith(f"{said}, not by its file or class (docs/extending.md).")


def test_a_gymnasium_id_in_place_of_a_task_is_told_the_task():
    said = "'usbench/ProbePlane-v0' is the Gymnasium id of the task 'pp': give that name."
    with pytest.raises(records.ConfigurationError, match=re.escape(said)):
        Setting(task="usbench/ProbePlane-v0")


def test_the_pages_task_is_one(installed):
    (module,) = re.findall(r"```python\n# upright.py\n(.*?)```", PAGE.read_text(), re.DOTALL)
    installed("upright = other_tasks:UPRIGHT", module=module.replace('"upright:', '"other_tasks:'))
    row = tasks.row_of("upright")
    assert {start.angle_deg for start in suite.guidance_of("upright", row).starts} == {45}


def test_counts_of_a_row_are_whole_numbers():
    row = tasks.Row(env_id="other/Upright-v0", entry_point="other_tasks:UprightEnv", n_steps=16.0)
    assert repr(row.n_steps) == "16"


@pytest.mark.parametrize("count", [{"checkpoints": 0}, {"n_steps": 0}, {"repeats": -1}, {"phantoms": -1}])
def test_rows_with_counts_that_cannot_be_are_refused(count):
    (name,) = count
    with pytest.raises(ValueError, match=f"{name} must be a whole number from"):
        tasks.Row(env_id="other/Upright-v0", entry_point="other_tasks:UprightEnv", **count)


@pytest.mark.parametrize(
    ("point", "said"),
    [
        ("nowhere:Env", "ModuleNotFoundError: No module named 'nowhere'"),
        ("usbench.envs.pose:Pose", "AttributeError"),
        ("usbench", "ValueError"),
    ],
)
def test_an_environment_that_cannot_be_used_is_named(point, said):
    row = replace(tasks.row_of("pp"), env_id="other/Broken-v0", entry_point=point)
    with pytest.raises(records.ConfigurationError) as refused:
        suite.guidance_of("broken", row)
    assert str(refused.value).startswith(
        f"the environment '{point}' of the task 'broken' cannot be used ({said}"
    )
    assert "\n" not in str(refused.value)


def test_an_environment_whose_task_is_none_is_refused(installed):
    installed(module=MODULE.replace('replace(PROBE_PLANE, name="upright", ', "dict("))
    row = tasks.Row(env_id="other/None-v0", entry_point="other_tasks:UprightEnv")
    with pytest.raises(
        records.ConfigurationError, match="must have a `usbench.envs.task.Task` as its `task`, not"
    ):
        suite.guidance_of("none", row)


def test_a_row_that_does_not_fit_its_environment_is_refused():
    row = tasks.row_of("pp")
    with pytest.raises(records.ConfigurationError, match="must have the 16 steps of its environment, not"):
        suite.guidance_of("pp", replace(row, n_steps=24))
    with pytest.raises(records.ConfigurationError, match=r"senses of its environment, \(\), not"):
        suite.guidance_of("pp", replace(row, senses=("heading",)))


def test_an_environment_whose_first_action_moves_is_refused(installed):
    turned = "starts=PROBE_PLANE.starts[:1], actions=PROBE_PLANE.actions[::-1])"
    installed(module=MODULE.replace("starts=PROBE_PLANE.starts[:1])", turned))
    row = tasks.Row(env_id="other/Turned-v0", entry_point="other_tasks:UprightEnv")
    with pytest.raises(
        records.ConfigurationError, match="the first action of the task 'turned' must move nothing"
    ):
        suite.guidance_of("turned", row)


CODE = """
import sys
import sweep_worker
sweep_worker.quick()
from usbench import cli
sys.exit(cli.main(sys.argv[1:]))
"""


def command(tmp_path, *argv, start=("-c", CODE)):
    paths = os.pathsep.join([str(tmp_path), str(Path(__file__).parent / "support")])
    return subprocess.run(
        [sys.executable, *start, *argv], cwd=tmp_path, capture_output=True, text=True,
        env={**os.environ, "PYTHONPATH": paths},
    )  # fmt: skip


def test_it_is_trained_evaluated_and_read_back_like_any_other(installed, tmp_path):
    installed("upright = other_tasks:PLAIN")
    done = command(tmp_path, "run", "--algo", "vpg", "--task", "upright", "--quiet")
    assert done.returncode == 0, done.stderr
    (trial,) = records.load_trials(tmp_path / "runs")
    assert trial.status == "finished" and trial.config.environment["id"] == "other/Upright-v0"
    assert "upright" in command(tmp_path, "list", start=("-m", "usbench")).stdout


@pytest.mark.parametrize(
    "argv",
    [
        ["watch", "{trial}"],
        ["report", "{runs}"],
        ["leaderboard", "--runs", "{runs}", "--leaderboard", "{runs}/leaderboard.md"],
        ["guide", "{trial}", "--no-browser"],
    ],
)
def test_a_trial_whose_package_is_gone_is_refused_with_its_task(finished, capsys, argv):
    state = read_state(finished)
    state["config"]["task"] = "upright"
    write_state(finished, state)
    words = {"trial": finished, "runs": finished.parent}
    assert cli.main([word.format(**words) for word in argv]) == 2
    captured = capsys.readouterr()
    *_, said = captured.err.splitlines()
    assert said.startswith("usbench: error: ")
    assert said.endswith("unknown task 'upright': no installed package brings it.")
    assert "http" not in captured.out


def test_a_broken_package_ends_the_command_with_status_2(installed, tmp_path):
    installed("upright = nowhere:ROW")
    done = command(tmp_path, "run", "--algo", "vpg", "--task", "pp", start=("-m", "usbench"))
    assert done.returncode == 2 and done.stderr.count("\n") == 1
    assert "the package 'other0' cannot be imported" in done.stderr
