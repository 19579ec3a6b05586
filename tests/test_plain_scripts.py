"""The plain scripts that `make bench-train` times compute what the algorithms here do, up to rounding."""

import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from gymnasium import spaces
from stable_baselines3.common.vec_env import DummyVecEnv
from torch.nn import functional

from usbench.agents import zoo
from usbench.agents.networks import ConvTrunk
from usbench.setting import Setting

# Small, so that two updates take a second.
SMALL = {"n_steps": 16, "batch_size": 8, "buffer_size": 32, "learning_starts": 16}
STEPS = 32


@pytest.fixture
def plain(monkeypatch):
    """The folder of the plain scripts, importable."""
    monkeypatch.syspath_prepend(str(Path(__file__).parents[1] / "benchmarks"))
    yield
    for name in [name for name in sys.modules if name.split(".")[0] == "plain"]:
        del sys.modules[name]


@pytest.fixture
def any_types(monkeypatch):
    """Errors of numbers of two types have gradients, which older versions of PyTorch refuse."""
    plainly = functional.mse_loss
    monkeypatch.setattr(functional, "mse_loss", lambda found, wanted: plainly(found, wanted.to(found.dtype)))


def distance(ours, theirs):
    """The distance of two lists of tensors, beside their size."""
    ours, theirs = (torch.cat([part.detach().flatten() for part in parts]) for parts in (ours, theirs))
    return float((ours - theirs).norm() / ours.norm())


@pytest.mark.parametrize("batch_statistics", [True, False])
def test_same_weights_give_the_same_features_and_gradients(plain, batch_statistics):
    from plain.network import RunningNorm, trunk

    torch.manual_seed(0)
    here = ConvTrunk(spaces.Box(-1, 1, (90, 40, 4)), batch_statistics)
    there = trunk(4, torch.nn.BatchNorm2d if batch_statistics else RunningNorm)
    for ours, theirs in zip(here.parameters(), there.parameters(), strict=True):
        theirs.data.copy_(ours)
    for _ in range(2):  # the second update begins with what the first left behind
        for net in (here, there):
            net.train()
        for _ in range(2):
            images, weights = torch.randn(8, 90, 40, 4), torch.randn(7040)
            for net, seen in ((here, images), (there, images.permute(0, 3, 1, 2))):
                net.zero_grad()
                net(seen).square().mul(weights).mean().backward()
            gradients = ([part.grad for part in net.parameters()] for net in (here, there))
            assert distance(*gradients) <= 1e-4
        for net in (here, there):
            net.eval()
        assert distance([here(images)], [there(images.permute(0, 3, 1, 2))]) <= 1e-5


def ours(algo, hyperparameters):
    return zoo.make(algo, DummyVecEnv([Setting(task="pp").make_env]), 0, hyperparameters, device="cpu")


def as_double(inputs):
    return tuple(as_double(part) if isinstance(part, tuple) else part.double() for part in inputs)


def in_double(*networks):
    """Lets the networks compute in float64: where a gradient is nought, Adam moves as rounding says."""
    for network in networks:
        for module in network.double().modules():
            if isinstance(module, (ConvTrunk, torch.nn.Conv2d, torch.nn.LSTM)):
                module.register_forward_pre_hook(lambda _, inputs: as_double(inputs))


def learnt(model, parameters):
    """How far learning takes the parameters."""
    before = [part.detach().clone() for part in parameters]
    torch.manual_seed(1)
    np.random.seed(1)
    model.learn(STEPS)
    return [part - was for part, was in zip(parameters, before, strict=True)]


@pytest.mark.parametrize("algo", ["a2c", "ppo", "dqn", "qrdqn", "trpo", "recurrent_ppo"])
def test_stable_baselines_learns_the_same(quick, plain, any_types, algo):
    from plain import sb3

    hyperparameters = zoo.hyperparameters(algo, "pp")
    hyperparameters |= {name: value for name, value in SMALL.items() if name in hyperparameters}
    here, there = ours(algo, hyperparameters), sb3.make(algo, "pp", hyperparameters)
    in_double(here.policy, there.policy)
    parameters = [list(model.policy.parameters()) for model in (here, there)]
    assert all(torch.equal(*pair) for pair in zip(*parameters, strict=True))
    moved = [learnt(*pair) for pair in zip((here, there), parameters, strict=True)]
    assert distance(*moved) <= 0.001


def test_spinning_up_learns_the_same(quick, plain, any_types):
    from plain.environment import make_env
    from plain.spinning_up import VPG

    hyperparameters = zoo.hyperparameters("vpg", "pp") | {"n_steps": SMALL["n_steps"]}
    here, there = ours("vpg", hyperparameters), VPG(make_env("pp"), 0, **hyperparameters)
    in_double(here.policy, there.policy, there.value)
    parameters = [
        [*here.policy.policy_parameters(), *here.policy.value_parameters()],
        [*there.policy.parameters(), *there.value.parameters()],
    ]
    for first, second in zip(*parameters, strict=True):
        second.data.copy_(first)
    moved = [learnt(*pair) for pair in zip((here, there), parameters, strict=True)]
    assert distance(*moved) <= 0.001
