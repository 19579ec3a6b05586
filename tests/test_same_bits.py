"""Same bits everywhere: alone, in a pool of processes, on a cluster; and who differs says so."""

import functools
import sys
from pathlib import Path

import pytest

from usbench import leaderboard, models, records, results, runner, sweep
from usbench.cluster import Cluster

sys.path.insert(0, str(Path(__file__).parent))  # so that worker processes find `sweep_worker`
import sweep_worker
import torch
from conftest import DrawnFrames

ALGOS = ("vpg", "dqn", "random")
# When and for how long is all that may differ.
OWN = ("started", "timings")


class Notes:
    """A `sweep.Progress` that says nothing."""

    def frames(self, *_):
        pass

    started = ended = retried = frames


def plan(steps=64):
    return [runner.resolve(algo, "pp", steps=steps, noise=0.5) for algo in ALGOS]


def bits(out):
    """Record files, states but for what is a run's own, and weights."""
    found = {}
    for folder in records.trial_folders(out):
        state = records.read_state(folder)
        assert state["status"] == "finished"
        found[folder.name] = {
            "state": {key: value for key, value in state.items() if key not in OWN},
            **{path.name: path.read_bytes() for path in folder.glob("*.jsonl")},
            "weights": _weights(folder),
        }
    assert len(found) == len(ALGOS)
    return found


def _weights(folder):
    agent = models.load_agent(folder).agent
    if not isinstance(getattr(agent, "policy", None), torch.nn.Module):
        return None
    return {name: tensor.numpy().tobytes() for name, tensor in agent.policy.state_dict().items()}


def test_alone_in_a_pool_and_on_a_cluster(quick, tmp_path):
    distributed = pytest.importorskip("distributed")
    for config in plan():
        runner.run_trial(config, tmp_path / "alone")
    pool = functools.partial(sweep.processes, sweep_worker.quick)
    sweep.run(plan(), tmp_path / "pool", Notes(), jobs=2, executor=pool)
    with (
        distributed.LocalCluster(
            n_workers=2,
            threads_per_worker=1,
            host="127.0.0.1",
            dashboard_address=None,
            preload=["sweep_worker"],
            silence_logs=100,
        ) as local,
        Cluster(local.scheduler_address) as workers,
    ):
        sweep.run(plan(), tmp_path / "cluster", Notes(), jobs=2, executor=lambda: workers, submitted=9)
    alone = bits(tmp_path / "alone")
    assert bits(tmp_path / "pool") == alone
    assert bits(tmp_path / "cluster") == alone


class BrighterFrames(DrawnFrames):
    """The frames of another machine: the last bit differs."""

    def frame(self, pose):
        return super().frame(pose) + 1


def test_machine_that_differs_says_so_in_record_and_footnote(quick, tmp_path, monkeypatch):
    configs = [runner.resolve("vpg", "pp", steps=64, seed=seed) for seed in range(3)]
    for config in configs[:2]:
        runner.run_trial(config, tmp_path / "runs")
    real = runner.version
    monkeypatch.setattr(runner, "version", lambda name: "0.1" if name == "numpy" else real(name))
    frames = BrighterFrames()
    monkeypatch.setattr("usbench.runner.frame_store", lambda *_: frames)
    runner.run_trial(configs[2], tmp_path / "runs")

    states = [records.read_state(tmp_path / "runs" / config.folder_name) for config in configs]
    digests = [state["frames"]["digest"] for state in states]
    assert digests[0] == digests[1] != digests[2]
    assert [state["versions"]["numpy"] for state in states] == [real("numpy"), real("numpy"), "0.1"]

    known = results.collect(tmp_path / "runs", configs)
    results.write(known, tmp_path / "board_files")
    leaderboard.write(tmp_path / "board_files", tmp_path / "board.md")
    text = (tmp_path / "board.md").read_text()
    odd = configs[2].folder_name
    assert f"Versions of numpy differ between trials: {real('numpy')} in 2, 0.1 in 1 (`{odd}`)." in text
    assert f"(their digests): {digests[0][:16]} in 2, {digests[2][:16]} in 1 (`{odd}`)." in text
