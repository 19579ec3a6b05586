"""Input by the thousand: whatever comes is handled, or refused in one sentence.

`USBENCH_FUZZ=1000 python -m pytest tests/test_fuzz.py` tries so many of each kind (100 without it) and says
how many it tried.
"""

import contextlib
import io
import json
import os
import shutil
from collections import Counter

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from usbench import cli, records, results, runner, sweep
from usbench.agents import zoo
from usbench.envs.pose import Pose
from usbench.models import load_agent
from usbench.records import ConfigurationError, TrialConfig

TRIED = Counter()
fuzz = settings(
    max_examples=int(os.environ.get("USBENCH_FUZZ", "100")),
    deadline=None,
    database=None,
    # Fixtures are made once for all examples: each example leaves them as it found them.
    suppress_health_check=list(HealthCheck),
)

NUMBERS = st.one_of(
    st.integers(),
    st.floats(),
    st.sampled_from(
        [0, 1, -1, 4, 16, 0.25, 2**31, 2**32, 2**63, 1e300, 1e-300, True, np.int64(3), np.float32(0.5)]
    ),
)
ANYTHING = st.one_of(
    NUMBERS,
    st.text(max_size=12),
    st.sampled_from([None, b"", {}, 1j, object()]),
    st.lists(NUMBERS, max_size=2),
)
NAMES = st.sampled_from(
    [*zoo.ZOO, "fp", "pp", "spinup", "os:system", "a:b:c", ":", "x_mm", "gamma", "n_steps"]
)
JSON = st.recursive(
    st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=8), NAMES),
    lambda inner: st.one_of(
        st.lists(inner, max_size=3), st.dictionaries(st.text(max_size=8), inner, max_size=3)
    ),
    max_leaves=6,
)


@pytest.fixture(scope="module", autouse=True)
def _report(request):
    TRIED.clear()
    yield
    terminal, capture = (
        request.config.pluginmanager.getplugin(name) for name in ("terminalreporter", "capturemanager")
    )
    if terminal is not None:  # none in the workers of pytest-xdist
        parts = [f"{kind} {number}" for kind, number in sorted(TRIED.items())]
        with capture.global_and_fixture_disabled():
            terminal.write_line(f"\n{TRIED.total()} inputs tried: {', '.join(parts)}")


def one_sentence(text):
    return bool(text) and "\n" not in text and "Traceback" not in text


def tried(kind, call, *refusals):
    """Call; one of `refusals`, if it comes, has to be a sentence. Returns the result, None if refused."""
    try:
        result = call()
    except refusals as error:
        assert one_sentence(str(error)), repr(error)
        TRIED[f"{kind}, refused:"] += 1
        return None
    TRIED[f"{kind}, handled:"] += 1
    return result


# Command lines


class Accepted(Exception):
    """What a command would do is not done here."""


# fmt: off
KNOWN_WORDS = [
    "0", "1", "2", "-1", "0.25", "1e9", "1e400", "nan", "inf", "-inf", "0x10", "1_000", "-", "--", "=",
    "%", "%s", "é", "fp", "pp", "vpg", "stay", "spinup", "gamma=0.9", "gamma=", "gamma=nan", "n_steps=7",
    "n_steps=64", "file", "folder", "folder/new", "file/below", "x.gif", "os:system", "tcp://host:1",
]
KNOWN_OPTIONS = [
    "--algo", "--algos", "--task", "--tasks", "--noise", "--seed", "--seeds", "--steps", "--preset",
    "--set", "--out", "--overwrite", "--quiet", "--jobs", "--cluster", "--leaderboard", "--candidates",
    "--clear", "--episode", "--drawn", "--formats", "--x", "--depth", "--angle", "--kind", "--plain",
    "--help", "--version", "--nothing",
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
OPTIONS = st.sampled_from(KNOWN_OPTIONS)
STARTS = st.sampled_from(
    [
        start.split()
        for start in (
            *("", "run", "compare", "search", "leaderboard", "list", "cache", "watch", "plot", "frame"),
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
    monkeypatch.setattr("usbench.search.run", accepted)
    monkeypatch.setattr("usbench.cluster._connect", accepted)
    monkeypatch.setattr("usbench.still.take", accepted, raising=False)
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
        lambda: runner.resolve(
            algo, task, noise=noise, seed=seed, steps=steps, preset=preset, overrides=overrides
        ),
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
        lambda: runner.resolve(algo, "pp", noise=noise, steps=steps, overrides={name: value}),
        ConfigurationError,
    )
    if config is not None:
        # What was resolved can be written, has one name, and is the same when it is resolved again.
        assert json.loads(json.dumps(dict(config.hyperparameters), allow_nan=False))[name] is not None
        again = runner.resolve(
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


# Record files


@pytest.fixture
def trial(finished, tmp_path):
    """A finished trial, and a whole copy beside it that is put back after each example."""
    whole = tmp_path / "whole"
    shutil.copytree(finished, whole)
    return finished, whole


def read_all(folder):
    """Everything that reads the records of a trial that may be a stranger's."""
    records.read_state(folder)
    for table in ("evaluations", "episodes"):
        records.load(folder.parent, table)
    results.collect(folder.parent)


FILES = st.sampled_from([records.TRIAL, records.EPISODES, records.EVALUATIONS])


@fuzz
@given(name=FILES, where=st.floats(0, 1), junk=st.binary(max_size=20), cut=st.integers(0, 20))
def test_record_files_with_changed_bytes(trial, name, where, junk, cut):
    folder, whole = trial
    content = (whole / name).read_bytes()
    start = int(where * len(content))
    (folder / name).write_bytes(content[:start] + junk + content[start + cut :])
    before = contents(folder)
    tried("record files", lambda: read_all(folder), ValueError, OSError)
    assert contents(folder) == before
    shutil.copy(whole / name, folder / name)


@fuzz
@given(name=FILES, where=st.integers(0, 10**6), value=JSON, drop=st.booleans())
def test_record_files_with_other_values(trial, name, where, value, drop):
    folder, whole = trial
    lines = (whole / name).read_text().splitlines() if name != records.TRIAL else [(whole / name).read_text()]
    row = json.loads(lines[where % len(lines)])
    change(row, where, value, drop)
    lines[where % len(lines)] = json.dumps(row)
    (folder / name).write_text("\n".join(lines) + "\n")
    tried("record files", lambda: read_all(folder), ValueError, OSError)
    if name == records.TRIAL:
        loaded = tried("models", lambda: load_agent(folder), ConfigurationError)
        assert loaded is None or loaded.config.task in ("fp", "pp")
    shutil.copy(whole / name, folder / name)


def change(row, where, value, drop):
    """Put `value` in one place of the nested `row`, or take that place away."""
    places = []
    waiting = [row]
    while waiting:
        inner = waiting.pop()
        keys = list(inner) if isinstance(inner, dict) else range(len(inner))
        places += [(inner, key) for key in keys]
        waiting += [inner[key] for key in keys if isinstance(inner[key], dict | list)]
    inner, key = places[where % len(places)]
    if drop:
        del inner[key]
    else:
        inner[key] = value


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


@fuzz
@given(where=st.floats(0, 1), junk=st.binary(max_size=20), cut=st.integers(0, 20))
def test_model_files_with_changed_bytes(trial, where, junk, cut):
    folder, whole = trial
    content = (whole / records.MODEL).read_bytes()
    start = int(where * len(content))
    (folder / records.MODEL).write_bytes(content[:start] + junk + content[start + cut :])
    tried("models", lambda: load_agent(folder), ConfigurationError)
    shutil.copy(whole / records.MODEL, folder / records.MODEL)
