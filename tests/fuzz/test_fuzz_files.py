"""Files by the thousand: records and models with changed bytes and values, as in `test_fuzz.py`."""

import json
import shutil

import fuzzing
import pytest
from fuzzing import JSON, fuzz, tried
from hypothesis import given
from hypothesis import strategies as st
from state_files import read_state

from usbench import records
from usbench.records import ConfigurationError
from usbench.results import collecting
from usbench.trials.model_loading import load_agent

_report = pytest.fixture(scope="module", autouse=True)(fuzzing.report)


# Record files


@pytest.fixture
def trial(finished, tmp_path):
    """A finished trial, and a whole copy beside it that is put back after each example."""
    whole = tmp_path / "whole"
    shutil.copytree(finished, whole)
    return finished, whole


def read_all(folder):
    """Everything that reads the records of a trial that may be a stranger's."""
    read_state(folder)
    for table in ("evaluations", "episodes"):
        records.load(folder.parent, table)
    collecting.collect(folder.parent)


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
