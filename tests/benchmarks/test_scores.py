"""The program behind `make scores`: which trials are one agent."""

import shutil

import pytest
import scores
from state_files import read_state, write_state


@pytest.mark.parametrize(("key", "value"), [("n_envs", 2), ("environment", {"id": "other"})])
def test_trials_with_other_environments_are_rows_of_their_own(finished, key, value):
    other = shutil.copytree(finished, finished.with_name("other"))
    state = read_state(other)
    write_state(other, state | {"config": state["config"] | {key: value}})
    assert scores.table(finished.parent).row_count == 4  # greedy and sampled actions
    assert all(f"{key}=" in settings for settings in scores.trials(finished.parent)["settings"])
