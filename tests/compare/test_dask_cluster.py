"""Trials on a Dask cluster of this machine: same bits as anywhere, accidents, clusters that are refused."""

import dataclasses
import functools
import multiprocessing.forkserver
import os
import signal
import socket
import sys
import threading
import time

import children
import psutil
import pytest
import sweep_worker
import trials
from state_files import read_state

from usbench import cli, records
from usbench.compare import dask_cluster, sweep
from usbench.compare.dask_cluster import Cluster
from usbench.records import ConfigurationError
from usbench.trials import configuration, runner
from usbench.trials.configuration import resolve

dask = pytest.importorskip("dask")
distributed = pytest.importorskip("distributed")


class Notes:
    """A `sweep.Progress` that says nothing."""

    def frames(self, *_):
        pass

    started = ended = retried = frames


def start(**settings):
    """A cluster on loopback, without a dashboard; trials of workers in processes of their own are quick."""
    preload = ["sweep_worker"] if settings.get("processes", True) else []
    local = distributed.LocalCluster(
        **{"n_workers": 2, "threads_per_worker": 1, "preload": preload, **settings},
        host="127.0.0.1",
        protocol="tcp://",
        dashboard_address=None,
        silence_logs=100,
    )
    local.scheduler.http_server.stop()
    return local


@pytest.fixture(scope="module")
def cluster():
    """Two workers in processes of their own, forked from a process that has imported everything."""
    assert children.CONTEXT.get_start_method() == "forkserver"
    # Before Dask asks for one, which would have imported Dask alone.
    multiprocessing.forkserver.ensure_running()
    with dask.config.set({"distributed.worker.multiprocessing-method": "forkserver"}), start() as local:
        yield local


@pytest.fixture
def two(cluster):
    """The cluster with both workers, also after a test in which they died."""
    cluster.wait_for_workers(2, timeout=120)
    return cluster


def plan(*algos, steps=64):
    return [resolve(algo, "pp", steps=steps, noise=0.5) for algo in algos]


def run(configs, out, local):
    with Cluster(local.scheduler_address) as workers:
        return sweep.run(configs, out, Notes(), jobs=2, executor=lambda: workers, submitted=len(configs))


def contents(out, pattern):
    paths = [path for path in sorted(out.glob(pattern)) if path.is_file()]
    return {str(path.relative_to(out)): path.read_bytes() for path in paths}


def wait_until(condition):
    for _ in range(1200):
        if condition():
            return
        time.sleep(0.1)
    pytest.fail("waited for two minutes")


def refusal(address):
    with pytest.raises(ConfigurationError) as refused:
        Cluster(address)
    text = str(refused.value)
    assert "\n" not in text and text.endswith(".")
    return text


def test_same_bits_alone_and_on_a_cluster(often, tmp_path, two, undisturbed):
    configs = [trials.config("vpg"), trials.config("dqn")]
    outcomes = run(configs, tmp_path, two)
    assert {outcome.config.algo: outcome.reason for outcome in outcomes} == {"vpg": None, "dqn": None}
    for config in configs:
        alone, there = undisturbed(config.algo), tmp_path / config.folder_name
        assert trials.bits(there) == trials.bits(alone)
        assert {path.name for path in there.iterdir()} == {path.name for path in alone.iterdir()}
    # What is finished is skipped, as at home.
    before = contents(tmp_path, "*/*.json")
    run(configs, tmp_path, two)
    assert contents(tmp_path, "*/*.json") == before


def test_failed_trial_is_named_and_comes_back_too(quick, tmp_path, two):
    broken, whole = plan("vpg", "stay")
    broken = dataclasses.replace(broken, hyperparameters={"gamma": 7.0})
    reasons = {outcome.config.algo: outcome.reason for outcome in run([broken, whole], tmp_path, two)}
    assert "gamma must be" in reasons["vpg"] and reasons["stay"] is None
    state = read_state(tmp_path / broken.folder_name)
    assert state["status"] == "failed" and "gamma must be" in state["reason"]


def test_killed_worker_costs_only_its_unfinished_trials(quick, tmp_path, two, monkeypatch):
    slow, short = plan("vpg", "stay")
    mark = tmp_path / "pid"
    # The first worker that begins with vpg writes its pid there and dawdles; the next one works.
    monkeypatch.setattr(sweep, "work", functools.partial(sweep_worker.dawdle_once, mark))
    before = {}

    def kill():
        wait_until(lambda: read_state(tmp_path / short.folder_name).get("status") == "finished")
        wait_until(lambda: mark.exists() and mark.read_text())
        before.update(contents(tmp_path, "*/*"))
        os.kill(int(mark.read_text()), signal.SIGKILL)

    killer = threading.Thread(target=kill)
    killer.start()
    outcomes = run([slow, short], tmp_path, two)
    killer.join()
    assert {outcome.reason for outcome in outcomes} == {None} and len(outcomes) == 2
    assert {name.split("/")[0] for name in before} == {short.folder_name, ".locks"}
    assert before.items() <= contents(tmp_path, "*/*").items()
    assert read_state(tmp_path / slow.folder_name)["status"] == "finished"


def test_a_trial_with_which_every_worker_dies_is_named(quick, tmp_path, two, monkeypatch):
    monkeypatch.setattr(sweep, "work", sweep_worker.die)
    (outcome,) = run(plan("vpg"), tmp_path, two)
    died = dask.config.get("distributed.scheduler.allowed-failures") + 1
    assert outcome.reason == f"{died} workers died with it (killed, or out of memory)"


def test_trial_that_nobody_waits_for_stops(quick, tmp_path, two):
    (slow,) = plan("vpg", steps=160_000)
    with distributed.Client(two, set_as_default=False) as client:
        with Cluster(two.scheduler_address) as workers:
            workers.submit(sweep.work, slow, tmp_path)
            wait_until(lambda: sum(client.run(sweep_worker.busy).values()) == 1)
        wait_until(lambda: sum(client.run(sweep_worker.busy).values()) == 0)
    assert not (tmp_path / slow.folder_name).exists()


def test_lost_cluster_is_said(quick, tmp_path):
    (config,) = plan("vpg")
    with start(n_workers=1, processes=False) as local, Cluster(local.scheduler_address) as workers:
        ended = workers.submit(
            functools.partial(sweep_worker.dawdle_once, tmp_path / "pid"), config, tmp_path
        )
        wait_until((tmp_path / "pid").exists)
        threading.Timer(2.0, (tmp_path / "pid.end").touch).start()  # closing waits for the thread at work
        local.close()
        with pytest.raises(RuntimeError, match="cluster at tcp://.* is lost"):
            ended.result(timeout=60)


def test_nothing_listens_but_on_loopback(two):
    process = psutil.Process()
    sockets = [
        connection.laddr
        for each in (process, *process.children(recursive=True))
        for connection in each.net_connections()
        if connection.status == psutil.CONN_LISTEN
    ]
    assert sockets and {address.ip for address in sockets} == {"127.0.0.1"}
    assert 8787 not in {address.port for address in sockets}


def test_other_versions_are_refused(two, monkeypatch):
    real = configuration.versions(dask_cluster.PACKAGES)
    monkeypatch.setattr(configuration, "versions", lambda *_: {**real, "torch": "1.0"})
    said = refusal(two.scheduler_address)
    assert f"torch {real['torch']}, this machine 1.0" in said and "tcp://127.0.0.1:" in said


def test_worker_of_another_version_that_comes_later_is_refused(quick, tmp_path, two):
    expected = {**configuration.versions(dask_cluster.PACKAGES), "python": "2.7"}
    with distributed.Client(two, set_as_default=False) as client:
        late = client.submit(dask_cluster.on_worker, sweep.work, *plan("stay"), expected, pure=False)
        with pytest.raises(ConfigurationError, match=r"this machine 2\.7"):
            late.result()


def test_workers_of_several_threads_and_none_are_refused():
    with start(n_workers=1, threads_per_worker=2, processes=False) as local:
        assert "has 2 threads: start workers with --nthreads 1" in refusal(local.scheduler_address)
    with start(n_workers=0, processes=False) as local:
        assert "has no workers" in refusal(local.scheduler_address)


def test_cluster_that_does_not_answer_is_refused_soon(monkeypatch):
    monkeypatch.setattr(dask_cluster, "CONNECT_S", 0.5)
    with socket.create_server(("127.0.0.1", 0)) as mute:
        address = f"tcp://127.0.0.1:{mute.getsockname()[1]}"
        assert f"no Dask scheduler answers at {address}" in refusal(address)
    assert f"no Dask scheduler answers at {address}" in refusal(address)


@pytest.mark.parametrize("greeting", [b"", b"SSH-2.0-OpenSSH", b"220"])
def test_server_that_is_not_dask_is_refused_soon(monkeypatch, greeting):
    monkeypatch.setattr(dask_cluster, "CONNECT_S", 0.5)
    with socket.create_server(("127.0.0.1", 0)) as other:

        def greet():
            connection, _ = other.accept()
            connection.sendall(greeting)
            connection.close()

        server = threading.Thread(target=greet)
        server.start()
        assert "no Dask scheduler answers" in refusal(f"tcp://127.0.0.1:{other.getsockname()[1]}")
        server.join()


@pytest.mark.parametrize(
    "address",
    ["", "host", "host:8786", "tcp://", "tcp://host", "tcp://:8786", "tcp://host:port", "tcp://host:99999",
     "http://host:80", "udp://host:1", "tcp://host:8786/x", "tcp://[::1", "tcp://ho\nst:1", "inproc://1/2/3"],
)  # fmt: skip
def test_what_is_no_address_is_refused_at_once(address):
    assert "tcp://host:8786, not" in refusal(address)


def test_refusals_reach_the_command_line_in_one_sentence(quick, tmp_path, capsys, monkeypatch):
    argv = [
        "compare",
        "--out",
        str(tmp_path / "runs"),
        "--leaderboard",
        str(tmp_path / "board.md"),
        "--cluster",
    ]
    assert cli.main([*argv, "nowhere"]) == 2
    monkeypatch.setattr(dask_cluster, "CONNECT_S", 0.5)
    assert cli.main([*argv, "tcp://127.0.0.1:9"]) == 2
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert cli.main([*argv, "tcp://127.0.0.1:9"]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 3 and all(line.startswith("usbench: error: ") for line in lines)
    assert "nowhere" in lines[0] and "127.0.0.1:9" in lines[1] and "pip install 'usbench[dask]'" in lines[2]
    assert not (tmp_path / "runs").exists()


def test_folder_that_cannot_be_written_is_refused_before_anything_runs(quick, tmp_path, two):
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigurationError, match="choose another folder"):
        run(plan("stay"), tmp_path / "file", two)


@pytest.mark.parametrize(
    "name", ["../outside", "/outside", "tensorboard/../../outside", "other.txt", "tensorboard"]
)
def test_files_that_are_no_trials_are_not_written(quick, tmp_path, name):
    (config,) = plan("stay")
    with pytest.raises(ValueError, match="does not belong"):
        dask_cluster._bring({name: b"x"}, config, tmp_path / "runs")
    assert not list(tmp_path.rglob("*outside*")) and not (tmp_path / "runs").exists()


def test_a_trial_that_another_sweep_finished_meanwhile_stays(quick, tmp_path):
    (config,) = plan("stay")
    folder = runner.run_trial(config, tmp_path).folder
    before = (folder / "trial.json").read_bytes()
    dask_cluster._bring({"trial.json": b"another"}, config, tmp_path)
    assert records.trial_folders(tmp_path) == [folder]
    assert (folder / "trial.json").read_bytes() == before


def test_comparison_on_a_cluster_from_the_command_line(quick, tmp_path, two, monkeypatch):
    monkeypatch.setattr("usbench.figures.comparison.write", lambda *_: [])
    argv = [
        "compare",
        "--algos",
        "random",
        "--tasks",
        "pp",
        "--noise",
        "0",
        "--seeds",
        "1",
        "--quiet",
    ]
    out = ["--out", str(tmp_path / "runs"), "--leaderboard", str(tmp_path / "board.md")]
    assert cli.main([*argv, *out, "--cluster", two.scheduler_address]) == 0
    assert len(list((tmp_path / "runs").glob("*/model.zip"))) == 3
    assert "oracle" in (tmp_path / "board.md").read_text()
