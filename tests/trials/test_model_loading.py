"""Models from strangers: weights come in, code does not."""

import base64
import io
import json
import os
import pickle
import shutil
import zipfile

import gymnasium as gym
import numpy as np
import pytest
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import DummyVecEnv
from state_files import read_state, write_state

from usbench import records
from usbench.agents import zoo
from usbench.agents.vpg import VPG
from usbench.records import ConfigurationError
from usbench.setting import Setting, make_env
from usbench.trials import model_loading, runner
from usbench.trials.configuration import resolve
from usbench.trials.learning import make_agent


class Evil:
    """A pickle of it makes a folder when it is loaded."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return os.mkdir, (str(self.path),)


def rewrite(file, changes):
    """Write the archive again with other contents; None takes an entry away."""
    with zipfile.ZipFile(file) as archive:
        entries = {name: archive.read(name) for name in archive.namelist()} | changes
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in entries.items():
            if content is not None:
                archive.writestr(name, content)


def saved(thing):
    file = io.BytesIO()
    torch.save(thing, file)
    return file.getvalue()


def weights(file):
    with zipfile.ZipFile(file) as archive:
        return torch.load(io.BytesIO(archive.read(model_loading.WEIGHTS)), weights_only=True)


def refusal(path, **named):
    with pytest.raises(ConfigurationError) as refused:
        model_loading.load_agent(path, **named)
    text = str(refused.value)
    assert "\n" not in text and text.endswith(".")
    return text


def change_record(folder, **changes):
    state = read_state(folder)
    state["config"] |= changes
    write_state(folder, state)


def observations(task, n=5):
    env = make_env(task)
    return np.stack([env.reset(seed=seed)[0] for seed in range(n)])


def test_trial_is_opened_and_acts_as_the_model_that_was_saved(finished):
    loaded = model_loading.load_agent(finished)
    assert loaded.config == resolve("vpg", "pp", steps=128, noise=0.5)
    assert loaded.config.folder_name == finished.name
    seen = observations("pp")
    ours, _ = loaded.agent.predict(seen, deterministic=True)
    theirs, _ = VPG.load(finished / records.MODEL).predict(seen, deterministic=True)
    assert np.array_equal(ours, theirs)
    state = VPG.load(finished / records.MODEL).policy.state_dict()
    assert all(torch.equal(state[name], tensor) for name, tensor in loaded.agent.policy.state_dict().items())


def test_an_agents_environment_is_that_of_its_trial(finished):
    loaded = model_loading.load_agent(finished)
    env, same = loaded.make_env(), Setting.recorded(loaded.config).make_env()
    assert env.observation_space == same.observation_space and env.unwrapped.noise == loaded.config.noise
    seen, _ = env.reset(seed=0)
    assert np.array_equal(seen, same.reset(seed=0)[0])
    action, _ = loaded.agent.predict(seen, deterministic=True)
    env.step(int(action))


def test_nothing_is_unpickled_on_the_way(finished, monkeypatch):
    def forbidden(*_, **__):
        raise AssertionError("unpickled")

    monkeypatch.setattr("cloudpickle.loads", forbidden)
    monkeypatch.setattr("stable_baselines3.common.save_util.json_to_data", forbidden)
    model_loading.load_agent(finished)
    model_loading.load_agent(finished / records.MODEL)


@pytest.mark.parametrize("algo", [name for name, row in zoo.ZOO.items() if row.learns and not row.needs])
@pytest.mark.parametrize("task", ["fp", "pp"])
def test_every_algorithms_plain_zip_is_opened(quick, tmp_path, algo, task):
    config = resolve(algo, task)
    hyperparameters = config.hyperparameters
    if "buffer_size" in hyperparameters:
        hyperparameters = {**hyperparameters, "buffer_size": 10}
    model = zoo.make(algo, make_env(task), 7, hyperparameters, device="cpu")
    model.save(tmp_path / "strangers.zip")
    loaded = model_loading.load_agent(tmp_path / "strangers.zip", algo=algo, task=task)
    assert loaded.config == config
    state = model.policy.state_dict()
    assert all(torch.equal(state[name], tensor) for name, tensor in loaded.agent.policy.state_dict().items())
    actions, _ = loaded.agent.predict(observations(task), deterministic=True)
    assert actions.shape == (5,)


@pytest.mark.parametrize("algo", ["random", "stay", "oracle"])
def test_agents_that_do_not_learn_need_no_weights(quick, tmp_path, algo):
    config = resolve(algo, "fp", noise=0.25)
    folder = runner.run_trial(config, tmp_path).folder
    loaded = model_loading.load_agent(folder)
    assert loaded.config == config
    assert type(loaded.agent) is zoo.model_class(algo)


def test_code_among_the_weights_does_not_run_and_is_named(finished, tmp_path):
    trace = tmp_path / "trace"
    rewrite(
        finished / records.MODEL,
        {model_loading.WEIGHTS: saved({"weight": torch.zeros(1), "evil": Evil(trace)})},
    )
    said = refusal(finished)
    assert "would run code" in said and "mkdir" in said and "nothing in it was run" in said
    assert not trace.exists()
    # The file is what it claims to be: opened in the usual way, it does run.
    with zipfile.ZipFile(finished / records.MODEL) as archive:
        torch.load(io.BytesIO(archive.read(model_loading.WEIGHTS)), weights_only=False)
    assert trace.exists()


def test_code_in_a_bare_pickle_does_not_run(finished, tmp_path):
    trace = tmp_path / "trace"
    rewrite(finished / records.MODEL, {model_loading.WEIGHTS: pickle.dumps(Evil(trace))})
    assert "could run code" in refusal(finished)
    assert not trace.exists()


def test_code_beside_the_weights_does_not_run(finished, tmp_path):
    trace = tmp_path / "trace"
    with zipfile.ZipFile(finished / records.MODEL) as archive:
        data = json.loads(archive.read("data"))
    data["policy_class"] = {":serialized:": base64.b64encode(pickle.dumps(Evil(trace))).decode()}
    bad = {"policy.optimizer.pth": saved(Evil(trace)), "data": json.dumps(data).encode()}
    rewrite(finished / records.MODEL, bad)
    model_loading.load_agent(finished)
    assert not trace.exists()
    # The attack is real: Stable-Baselines3 runs it.
    with pytest.warns(UserWarning), pytest.raises(Exception, match=""):
        VPG.load(finished / records.MODEL)
    assert trace.exists()


def test_algorithm_of_its_own_is_not_imported_unless_named(finished, tmp_path, monkeypatch):
    (tmp_path / "strangers.py").write_text(
        "import pathlib\npathlib.Path('trace').touch()\nclass Agent: pass\n"
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    change_record(finished, algo="strangers:Agent")
    assert "'strangers:Agent', whose code would run" in refusal(finished)
    assert not (tmp_path / "trace").exists()
    assert "learn and predict" in refusal(finished, algo="strangers:Agent")
    assert (tmp_path / "trace").exists()


@pytest.mark.parametrize(
    "name", ["../outside", "a/../../outside", "/etc/passwd", "..\\outside", "C:\\outside", "\\\\host\\x"]
)
def test_names_that_lead_out_of_the_archive_are_refused(finished, name):
    rewrite(finished / records.MODEL, {name: b""})
    assert "leads out of the archive" in refusal(finished)


def test_model_of_another_network_is_refused(finished):
    tensors = weights(finished / records.MODEL)
    shorter = {**tensors, "action_net.bias": torch.zeros(4)}
    rewrite(finished / records.MODEL, {model_loading.WEIGHTS: saved(shorter)})
    assert "action_net.bias has shape (4,) instead of (5,)" in refusal(finished)
    del shorter["action_net.bias"]
    rewrite(finished / records.MODEL, {model_loading.WEIGHTS: saved(shorter)})
    assert "has no action_net.bias" in refusal(finished)
    rewrite(finished / records.MODEL, {model_loading.WEIGHTS: saved(tensors | {"more": torch.zeros(1)})})
    assert "more is not part of it" in refusal(finished)


def test_model_of_another_task_or_algorithm_is_refused(quick, tmp_path):
    PPO("MlpPolicy", gym.make("CartPole-v1"), device="cpu").save(tmp_path / "cartpole.zip")
    assert "does not fit ppo on pp" in refusal(tmp_path / "cartpole.zip", algo="ppo", task="pp")


def test_a_model_of_other_senses_is_refused_in_one_sentence(tmp_path):
    told = Setting(task="pp", senses=("heading",))
    settings = {**zoo.hyperparameters("dqn", "pp"), "buffer_size": 1}
    make_agent(told, "dqn", DummyVecEnv([told.make_env]), 0, settings).save(tmp_path / "model.zip")
    words = refusal(tmp_path / "model.zip", algo="dqn", task="pp-tracked")
    assert "does not fit dqn on pp-tracked: q_net.features_extractor.joint.0.weight has shape" in words
    assert "after training with other senses than position, heading, or with other than 4 frames" in words


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_weights_that_are_not_finite_are_refused(finished, value):
    tensors = weights(finished / records.MODEL)
    tensors["action_net.bias"][0] = value
    rewrite(finished / records.MODEL, {model_loading.WEIGHTS: saved(tensors)})
    assert "not finite" in refusal(finished)


def test_weights_that_are_not_kept_number_by_number_are_refused(finished):
    tensors = weights(finished / records.MODEL)
    tensors["action_net.bias"] = tensors["action_net.bias"].to_sparse()
    rewrite(finished / records.MODEL, {model_loading.WEIGHTS: saved(tensors)})
    assert "cannot be used" in (told := refusal(finished)) and "\n" not in told


@pytest.mark.parametrize("inner", [False, True])
def test_archive_that_unpacks_to_fill_the_memory_is_refused_unread(finished, inner):
    zeros = bytes(100_000_000)
    if inner:
        file = io.BytesIO()
        with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("archive/data.pkl", zeros)
        zeros = file.getvalue()
    rewrite(finished / records.MODEL, {model_loading.WEIGHTS: zeros})
    assert "would take 100000000 bytes" in refusal(finished)


def test_size_of_a_replay_buffer_is_not_believed(finished):
    hyperparameters = resolve("dqn", "pp", overrides={"buffer_size": 10_000_000}).hyperparameters
    change_record(finished, algo="dqn", hyperparameters=hyperparameters)
    assert "does not fit dqn" in refusal(finished)


@pytest.mark.parametrize("content", [b"", b"not a zip", b"PK\x05\x06" + bytes(18)])
def test_file_that_is_no_model_is_refused(finished, content):
    (finished / records.MODEL).write_bytes(content)
    assert "not a" in refusal(finished)


def test_model_cut_off_or_changed_is_refused(finished):
    whole = (finished / records.MODEL).read_bytes()
    (finished / records.MODEL).write_bytes(whole[: len(whole) // 2])
    assert "not a readable zip" in refusal(finished)
    start = whole.index(b"policy.pth") + 10_000
    (finished / records.MODEL).write_bytes(whole[:start] + bytes(100) + whole[start + 100 :])
    assert "not a readable zip" in refusal(finished)


def test_damaged_model_of_another_packing_is_refused(finished):
    # Every packing has errors of its own: this one's derive from Exception alone.
    file = finished / records.MODEL
    with zipfile.ZipFile(file, "w", zipfile.ZIP_LZMA) as archive:
        archive.writestr(model_loading.WEIGHTS, bytes(range(256)) * 4)
    whole = bytearray(file.read_bytes())
    start = (
        whole.index(model_loading.WEIGHTS.encode()) + len(model_loading.WEIGHTS) + 9
    )  # behind the packing's own head
    whole[start : start + 20] = b"\xff" * 20
    file.write_bytes(whole)
    assert "not a readable zip" in refusal(finished)


def test_weights_whose_own_table_of_contents_is_broken_are_refused(finished):
    content = saved(weights(finished / records.MODEL)).replace(b"PK\x01\x02", b"PK\x01\x00")
    rewrite(finished / records.MODEL, {model_loading.WEIGHTS: content})
    # Python 3.14 does not take such a file for an archive.
    is_archive = zipfile.is_zipfile(io.BytesIO(content))
    said = "is broken: its tensors cannot be read" if is_archive else "is no file of torch.save"
    assert said in refusal(finished)


@pytest.mark.parametrize("thing", [[torch.zeros(1)], {"a": 1}, {1: torch.zeros(1)}, torch.zeros(1), None])
def test_weights_that_are_no_named_tensors_are_refused(finished, thing):
    rewrite(finished / records.MODEL, {model_loading.WEIGHTS: saved(thing)})
    assert "else than named tensors" in refusal(finished)


def test_missing_files_are_named(finished, tmp_path):
    shutil.copy(finished / records.MODEL, tmp_path / "alone.zip")
    assert "say its algorithm and its task" in refusal(tmp_path / "alone.zip")
    assert "say its algorithm and its task" in refusal(tmp_path / "alone.zip", algo="vpg")
    assert "'alone2.zip'" in refusal("alone2.zip", algo="vpg", task="pp")
    (finished / records.MODEL).unlink()
    assert "there is no model" in refusal(finished)
    (finished / records.TRIAL).unlink()
    assert "no trial.json" in refusal(finished)
    assert "it does not exist" in refusal(tmp_path / "nothing")


def test_a_record_that_is_no_record_is_named_once(finished):
    (finished / records.TRIAL).write_text("[]")
    told = refusal(finished)
    assert told.startswith(str(finished)) and told.count(records.TRIAL) == 1


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"algo": "vgp"}, "'vpg'"),
        ({"algo": None}, "its config.algo cannot be None"),
        ({"task": "brain"}, "'brain'"),
        ({"task": ["pp"]}, "its config.task cannot be"),
        ({"noise": 2}, "noise"),
        ({"steps": "many"}, "steps"),
        ({"seed": -1}, "seed"),
        ({"n_frames": 10**9}, "n_frames"),
        ({"n_frames": "4"}, "n_frames"),
        ({"hyperparameters": {"gama": 1}}, "'gamma'"),
        ({"hyperparameters": {"n_steps": 10**9}}, "n_steps"),
        ({"hyperparameters": [1]}, "its config.hyperparameters cannot be"),
    ],
)
def test_record_that_is_no_configuration_is_refused(finished, changes, said):
    change_record(finished, **changes)
    assert said in refusal(finished)


@pytest.mark.parametrize(
    ("imaging", "said"),
    [
        ({"height_px": 500_000, "width_px": 500_000, "pixel_size": 1e-6}, "at most 100000000 pixels"),
        ({"width_px": 4}, "the agent of {!r} cannot be made"),
    ],
)
def test_agent_that_cannot_be_made_is_refused(finished, imaging, said):
    state = read_state(finished)
    state["config"]["environment"]["imaging"] |= imaging
    write_state(finished, state)
    assert said.format(str(finished)) in refusal(finished)


@pytest.mark.parametrize("text", ["", "[]", '{"config": 3}', "no JSON", "[" * 100_000])
def test_broken_record_is_refused(finished, text):
    (finished / records.TRIAL).write_text(text)
    assert "is not a trial record" in refusal(finished)


def test_the_record_of_a_trial_that_was_killed_in_its_first_moment_is_refused(finished):
    (finished / records.TRIAL).write_text("{}")
    assert refusal(finished).endswith("is not the folder of a trial: its trial.json holds none.")


def test_record_and_what_is_asked_for_must_agree(finished):
    model_loading.load_agent(finished, algo="vpg", task="pp")
    assert "records the algorithm 'vpg', not 'ppo'" in refusal(finished, algo="ppo")
    assert "records the task 'pp', not 'fp'" in refusal(finished, task="fp")
