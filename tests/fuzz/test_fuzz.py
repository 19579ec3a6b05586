"""Input by the thousand: whatever comes is handled, or refused in one sentence.

`USBENCH_FUZZ=1000 python -m pytest tests/fuzz` tries so many of each kind
(100 without it) and says how many it tried.
"""

import contextlib
import io
import json

import fuzzing
import gymnasium as gym
import pytest
from fuzzing import ANYTHING, NAMES, NUMBERS, TRIED, fuzz, tried
from hypothesis import given
from hypothesis import strategies as st

from usbench import cli
from usbench.agents import zoo
from usbench.compare import sweep
from usbench.envs.pose import Pose
from usbench.records import ConfigurationError, TrialConfig
from usbench.trials import runner
from usbench.trials.configuration import resolve

_report = pytest.fixture(scope="module", autouse=True)(fuzzing.report)


# Command lines


class Accepted(Exception):
    """What a command would do is not done here."""


# fmt: off
KNOWN_WORDS = [
    "0", "1", "2", "-1", "0.25", "1e9", "1e400", "nan", "inf", "-inf", "0x10", "1_000", "-", "--", "=",
    "%", "%s", "é", "fp", "pp", "vpg", "stay", "spinup", "gamma=0.9", "gamma=", "gamma=nan", "n_steps=7",
    "n_steps=64", "file", "folder", "folder/new", "file/below", "x.gif", "os:system", "tcp://host:1",
]
# fmt: on
WORDS = st.one_of(
    st.sampled_from([*KNOWN_WORDS, "", " ", "\n", "\udcff", "a" * 300]),
    # Nothing that leads out of the folder where the test runs.
    st.text(st.characters(exclude_characters="\0/~", codec="utf-8"), max_size=8).filter(
        lambda text: ".." not in text
    ),
    st.integers().map(str),
    st.floats().map(str),
)
COMMANDS = cli.build_parser()[1]
# All but those that reach out to a service, or show the traceback of a refusal.
OPTIONS = st.sampled_from(
    sorted(
        {
            option
            for parser in COMMANDS.values()
            for action in parser._actions
            for option in action.option_strings
        }
        - {"--wandb", "--debug", "-h"}
        | {"--version", "--nothing"}
    )
)
STARTS = st.sampled_from(
    [
        start.split()
        for start in (
            *("", *(name for name in COMMANDS if name != "guide")),
            *(
                "run --algo vpg --task pp",
                "compare --seeds 1 --algos vpg",
                "search --algo ppo",
                "watch folder",
            ),
        )
    ]
)


@pytest.fixture
def sandbox(tmp_path, monkeypatch, quick):
    """A folder of its own to run in, and commands that stop where they would begin to compute."""

    def accepted(*_, **__):
        raise Accepted("accepted")

    for module, name in ((runner, "run_trial"), (sweep, "run")):
        monkeypatch.setattr(module, name, accepted)
    monkeypatch.setattr("usbench.compare.search.run", accepted)
    monkeypatch.setattr("usbench.compare.dask_cluster._connect", accepted)
    monkeypatch.setattr("usbench.watch.snapshot.take", accepted)
    monkeypatch.setattr("usbench.datasets.minari_files.write", accepted)
    monkeypatch.setenv("USBENCH_CACHE", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("untouched")
    (tmp_path / "folder").mkdir()


@fuzz
@given(start=STARTS, rest=st.lists(st.one_of(OPTIONS, WORDS), max_size=6))
def test_command_lines(sandbox, start, rest):
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = cli.main([*start, *rest])
    said = err.getvalue()
    if status == cli.DONE:
        TRIED["command lines, handled:"] += 1
    elif "accepted" in said:
        TRIED["command lines, accepted:"] += 1
    else:
        assert status in (cli.REFUSED, cli.FAILED), status
        lines = said.splitlines()
        assert len(lines) == 1 and lines[0].startswith("usbench: error: "), said
        TRIED["command lines, refused:"] += 1
    with open("file") as file:
        assert file.read() == "untouched"


# Configuration


@fuzz
@given(
    algo=st.one_of(NAMES, ANYTHING),
    task=st.one_of(NAMES, ANYTHING),
    noise=ANYTHING,
    seed=ANYTHING,
    steps=ANYTHING,
    preset=st.one_of(st.none(), NAMES),
    overrides=st.dictionaries(st.one_of(NAMES, st.text(max_size=8)), ANYTHING, max_size=2),
)
def test_configurations_of_anything(algo, task, noise, seed, steps, preset, overrides):
    config = tried(
        "configurations",
        lambda: resolve(algo, task, noise=noise, seed=seed, steps=steps, preset=preset, overrides=overrides),
        ConfigurationError,
    )
    assert config is None or isinstance(config, TrialConfig)


@fuzz
@given(
    algo=st.sampled_from(list(zoo.ZOO)),
    name=st.sampled_from(sorted({name for row in zoo.ZOO.values() for name in row.hyperparameters})),
    value=st.one_of(ANYTHING, NUMBERS.map(str)),
    noise=st.floats(-0.1, 1.1),
    steps=st.integers(-2, 100),
)
def test_configurations_that_are_nearly_right(algo, name, value, noise, steps):
    config = tried(
        "configurations",
        lambda: resolve(algo, "pp", noise=noise, steps=steps, overrides={name: value}),
        ConfigurationError,
    )
    if config is not None:
        # What was resolved can be written, has one name, and is the same when it is resolved again.
        assert json.loads(json.dumps(dict(config.hyperparameters), allow_nan=False))[name] is not None
        again = resolve(
            algo, "pp", noise=config.noise, steps=config.steps or None, overrides=config.hyperparameters
        )
        assert again.folder_name == config.folder_name


# Poses and reset options


@fuzz
@given(x_mm=ANYTHING, focal_depth_mm=ANYTHING, angle_deg=ANYTHING)
def test_poses(x_mm, focal_depth_mm, angle_deg):
    pose = tried("poses", lambda: Pose(x_mm, focal_depth_mm, angle_deg), ValueError, TypeError)
    if pose is not None:
        assert {type(pose.x_mm), type(pose.focal_depth_mm), type(pose.angle_deg)} == {int}
        assert 0 <= pose.angle_deg < 360 and pose.focal_depth_mm >= 1


COORDINATES = st.one_of(st.sampled_from(["x_mm", "focal_depth_mm", "angle_deg"]), st.text(max_size=4))


@fuzz
@given(
    seed=st.one_of(st.none(), NUMBERS),
    options=st.one_of(
        ANYTHING,
        st.dictionaries(COORDINATES, st.one_of(st.integers(-30, 100), ANYTHING), max_size=3),
    ),
)
def test_reset_options(env, seed, options):
    # Gymnasium's own refusal of a seed is an error of its own kind.
    result = tried(
        "reset options",
        lambda: env.reset(seed=seed, options=options),
        ValueError,
        TypeError,
        gym.error.Error,
    )
    if result is not None:
        assert env.observation_space.contains(result[0])
    # Whatever came: the next episode begins as usual.
    observation, _ = env.reset(seed=0)
    assert env.observation_space.contains(observation)


@pytest.fixture
def env(quick):
    return gym.make("usbench/FocalPoint-v0")
