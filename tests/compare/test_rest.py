"""A table that takes the best of the other rows waits for the whole grid, and then takes it."""

import protocols
import pytest
from made_tables import made, trial

from usbench import cli
from usbench.compare import plan, protocol, rest
from usbench.records import ConfigurationError
from usbench.results import tables

EXTRA = """
[[comparison.extras]]
name = "more"
rows = ["vpg"]
tasks = ["exam"]
noises = [0.0]
seeds = 2

[[comparison.extras]]
name = "frames"
noises = [0.0]
seeds = 2
n_frames = 1
"""
SCORES = {"vpg": 0.9, "a2c": 0.7, "dqn": 0.8, "ppo": 0.6}


@pytest.fixture
def rules(tmp_path, monkeypatch):
    """A protocol whose grid has four rows, and under which nothing was searched."""
    monkeypatch.setattr(protocol, "winners", dict)
    text = protocols.QUICK.replace('[comparison]\nrows = ["a2c"]', f"[comparison]\nrows = {list(SCORES)}")
    return protocol.read(protocols.write(tmp_path, text=text + EXTRA))


def results(rules, left_out=0):
    """Results of the grid as if its trials were done; the last are left out."""
    rows = [
        trial(
            config.algo,
            SCORES.get(config.algo, 1.0),
            task=config.task,
            seed=config.seed,
            steps=config.steps,
            trial=config.folder_name,
            configuration=config.algo,
        )
        for config in plan.by_protocol(rules)
    ]
    return made(*rows[: len(rows) - left_out])


def test_the_best_of_the_other_rows_joins_those_that_are_named(rules, tmp_path):
    tables.write(results(rules), tmp_path / "files")
    assert rest.rows(rules, "more", tmp_path / "runs", tmp_path / "files") == ("vpg", "dqn")


def test_tables_that_name_no_rows_and_the_grid_do_not_ask(rules, tmp_path):
    for table in (None, "frames"):
        assert rest.rows(rules, table, tmp_path / "runs", tmp_path / "files") is None


@pytest.mark.parametrize(("left_out", "finished"), [(1, 10), (11, 0)])
def test_a_grid_that_is_not_complete_is_refused(rules, tmp_path, left_out, finished):
    tables.write(results(rules, left_out), tmp_path / "files")
    message = f"best of the other rows by the grid, of which {finished} of 11 trials are finished"
    with pytest.raises(ConfigurationError, match=message):
        rest.rows(rules, "more", tmp_path / "runs", tmp_path / "files")


def test_without_any_record_it_is_refused(rules, tmp_path):
    (tmp_path / "runs").mkdir()
    with pytest.raises(ConfigurationError, match="of which 0 of 11 trials are finished"):
        rest.rows(rules, "more", tmp_path / "runs", tmp_path / "files")


def test_the_command_refuses_in_one_sentence(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["compare", "--table", "other-tasks", "--report-only"]) == 2
    told = capsys.readouterr().err.strip()
    assert told.count("\n") == 0 and "run what is missing of the grid first" in told
    assert not (tmp_path / "tables").exists()


def test_a_further_table_has_a_folder_of_its_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "runs").mkdir()
    written = []
    monkeypatch.setattr("usbench.compare.runs.report", lambda planned, out, path: written.append(path) or [])
    for more in ([], ["--table", "long"], ["--table", "long", "--leaderboard", "mine.md"]):
        assert cli.main(["compare", *more, "--report-only"]) == 0
    assert [str(path) for path in written] == ["leaderboard.md", "tables/long/leaderboard.md", "mine.md"]
