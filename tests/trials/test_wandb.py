"""Weights & Biases beside a trial: offline it keeps what TensorBoard gets and draws no random number."""

import contextlib
import random
import sys

import numpy as np
import pytest
from stable_baselines3.common.logger import configure

from usbench import cli
from usbench.figures import learning_curve
from usbench.records import ConfigurationError
from usbench.trials import wandb_run
from usbench.trials.configuration import resolve
from usbench.watch import replay

RUN = ["run", "--algo", "stay", "--task", "pp", "--quiet", "--wandb"]


@pytest.fixture
def wandb(tmp_path, monkeypatch):
    module = pytest.importorskip("wandb")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("WANDB_MODE", "offline")
    monkeypatch.setenv("WANDB_SILENT", "true")
    return module


# Its dependencies warn, of what is not ours to fix.
@pytest.mark.filterwarnings("ignore")
def test_offline_run_keeps_what_tensorboard_gets(wandb, tmp_path):
    config = resolve("vpg", "pp", noise=0.25)
    before = random.getstate(), repr(np.random.get_state())
    with wandb_run.followed(config):
        logger = configure(str(tmp_path / "tensorboard"), ["tensorboard"])
        logger.record("evaluation/normalized_score_deterministic", 0.5)
        logger.dump(16)
        logger.close()
    assert (random.getstate(), repr(np.random.get_state())) == before
    wandb.teardown()  # its service writes the file to its end
    (kept,) = (tmp_path / "wandb").glob("offline-run-*/*.wandb")
    for name in (config.folder_name, "evaluation/normalized_score_deterministic", "n_value_steps"):
        assert name.encode() in kept.read_bytes()


@pytest.mark.filterwarnings("ignore")
def test_run_that_cannot_begin_is_refused(wandb, monkeypatch):
    def refuse(**_):
        raise wandb.Error("api_key not\nconfigured")

    monkeypatch.setattr(wandb, "init", refuse)
    with (
        pytest.raises(ConfigurationError, match=r"\(api_key not configured\).*WANDB_MODE=offline"),
        wandb_run.followed(resolve("vpg", "pp")),
    ):
        pytest.fail("the trial began")


def test_what_is_not_installed_is_refused_before_anything_is_made(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "wandb", None)
    assert cli.main([*RUN, "--out", str(tmp_path / "runs")]) == 2
    (told,) = capsys.readouterr().err.splitlines()
    assert "Weights & Biases, which is to follow the trial, is not installed" in told
    assert "usbench[wandb]" in told
    assert not list(tmp_path.iterdir())


def test_finished_trial_is_not_followed_again(quick, tmp_path, monkeypatch):
    followed = []

    @contextlib.contextmanager
    def follow(config):
        followed.append(config.folder_name)
        yield

    monkeypatch.setattr(wandb_run, "followed", follow)
    for module, name in ((learning_curve, "write"), (replay, "write_gif")):
        monkeypatch.setattr(module, name, lambda folder: folder)
    for more, count in (([], 1), ([], 1), (["--overwrite"], 2)):
        # One that is followed needs the package, one that is shown again does not.
        needed = len(followed) < count
        monkeypatch.setitem(sys.modules, "wandb", sys if needed else None)
        assert cli.main([*RUN, "--out", str(tmp_path), *more]) == 0
        assert len(followed) == count


def test_a_folder_that_weights_and_biases_left_is_not_weights_and_biases(tmp_path, monkeypatch):
    (tmp_path / "wandb").mkdir()
    monkeypatch.setattr(sys, "path", [str(tmp_path)])
    monkeypatch.delitem(sys.modules, "wandb", raising=False)
    with pytest.raises(ConfigurationError, match="is not installed"):
        wandb_run.check_installed()
