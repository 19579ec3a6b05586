"""Trials of machines or versions that differ are told of (the same bits everywhere: test_dask_cluster.py)."""

from quick_trials import DrawnFrames
from state_files import read_state

from usbench.results import collecting, leaderboard, tables
from usbench.trials import runner
from usbench.trials.configuration import resolve


class BrighterFrames(DrawnFrames):
    """The frames of another machine: the last bit differs."""

    def frame(self, pose):
        return super().frame(pose) + 1


def test_machine_that_differs_says_so_in_record_and_footnote(quick, tmp_path, monkeypatch):
    configs = [resolve("vpg", "pp", steps=64, seed=seed) for seed in range(3)]
    for config in configs[:2]:
        runner.run_trial(config, tmp_path / "runs")
    real = runner.versions()["numpy"]
    other = {**runner.versions(), "numpy": "0.1"}
    monkeypatch.setattr(runner, "versions", lambda: other)
    frames = BrighterFrames()
    monkeypatch.setattr("usbench.setting_parts.evaluation_frames.frame_store", lambda *_: frames)
    runner.run_trial(configs[2], tmp_path / "runs")

    states = [read_state(tmp_path / "runs" / config.folder_name) for config in configs]
    digests = [state["frames"]["digest"] for state in states]
    assert digests[0] == digests[1] != digests[2]
    assert [state["versions"]["numpy"] for state in states] == [real, real, "0.1"]

    known = collecting.collect(tmp_path / "runs", configs)
    tables.write(known, tmp_path / "board_files")
    leaderboard.write(tmp_path / "board_files", tmp_path / "board.md")
    text = (tmp_path / "board.md").read_text()
    odd = configs[2].folder_name
    assert f"Versions of numpy differ between trials: {real} in 2, 0.1 in 1 (`{odd}`)." in text
    assert "Frames of pp differ between trials: 2 kinds, in 2 + 1 trials (`frames` in `trials.csv`)." in text
