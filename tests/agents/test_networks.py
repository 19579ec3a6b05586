import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch
from stable_baselines3 import DQN
from stable_baselines3.common.utils import polyak_update
from torch import nn

from usbench.agents.networks import Block, ConvTrunk, ProjectedTrunk
from usbench.agents.policies import ConvPolicy, SeparatePolicy

FRAMES = gym.spaces.Box(-10, 10, (90, 40, 4), np.float32)
ACTIONS = gym.spaces.Discrete(5)


def layers(module: nn.Module) -> list[nn.Module]:
    return [layer for layer in module.modules() if not list(layer.children())]


def test_trunk_has_the_layers_of_the_specification_in_order() -> None:
    found = layers(ConvTrunk(FRAMES))
    assert [type(layer) for layer in found] == [nn.Conv2d, nn.BatchNorm2d, nn.ReLU, nn.MaxPool2d] * 2
    convolutions = [layer for layer in found if isinstance(layer, nn.Conv2d)]
    assert [(c.in_channels, c.out_channels, c.kernel_size) for c in convolutions] == [
        (4, 16, (3, 3)),
        (16, 32, (3, 3)),
    ]
    assert [layer.kernel_size for layer in found if isinstance(layer, nn.MaxPool2d)] == [2, 2]


def test_each_network_ends_in_one_fully_connected_layer() -> None:
    policy = ConvPolicy(FRAMES, ACTIONS, lambda _: 1e-4)
    assert (policy.action_net.in_features, policy.action_net.out_features) == (32 * 22 * 10, 5)
    assert (policy.value_net.in_features, policy.value_net.out_features) == (32 * 22 * 10, 1)
    assert list(policy.mlp_extractor.parameters()) == []


def test_policy_and_value_share_no_parameter_and_together_are_all() -> None:
    policy = ConvPolicy(FRAMES, ACTIONS, lambda _: 1e-4)
    of_policy, of_value = set(policy.policy_parameters()), set(policy.value_parameters())
    assert of_policy.isdisjoint(of_value)
    assert of_policy | of_value == set(policy.parameters())
    assert policy.action_net.weight in of_policy
    assert policy.value_net.weight in of_value


def with_statistics(trunk: ConvTrunk) -> ConvTrunk:
    norm = trunk.blocks[0][1]
    with torch.no_grad():
        # A negative scale turns the order of pixels round before pooling, and zero makes a channel constant.
        norm.weight.copy_(torch.linspace(-1, 1, 16))
        norm.weight[3] = 0.0
        norm.bias.copy_(torch.linspace(-0.5, 0.5, 16))
        norm.running_mean.fill_(0.1)
        norm.running_var.fill_(2.0)
    return trunk


@pytest.mark.parametrize("training", [False, True])
def test_learning_without_batch_statistics_is_the_textbook_formula_too(training: bool) -> None:
    torch.manual_seed(0)
    trunk = with_statistics(ConvTrunk(FRAMES, batch_statistics=False)).train(training)
    conv, norm = trunk.blocks[0][0], trunk.blocks[0][1]
    images = torch.randn(3, 90, 40, 4)
    with torch.no_grad():
        maps = conv(images.permute(0, 3, 1, 2))
        column = (slice(None), None, None)
        maps = (maps - 0.1) / (2.0 + norm.eps) ** 0.5
        maps = torch.relu(maps * norm.weight[column] + norm.bias[column])
        expected = maps.reshape(3, 16, 45, 2, 20, 2).amax((3, 5))
    found = trunk.blocks[0](images.permute(0, 3, 1, 2))
    assert found.requires_grad
    torch.testing.assert_close(found, expected, rtol=1e-4, atol=1e-5)


def test_gradients_are_those_of_the_layers_one_by_one() -> None:
    torch.manual_seed(0)
    folded = with_statistics(ConvTrunk(FRAMES, batch_statistics=False)).blocks[0].double().train()
    plain = nn.Sequential(*Block(4, 16).double()).eval()
    plain.load_state_dict(folded.state_dict())
    images = torch.randn(6, 4, 45, 20).double()
    inputs = [images.clone().requires_grad_() for _ in range(2)]
    outputs = [folded(inputs[0]), plain(inputs[1])]
    torch.testing.assert_close(outputs[0], outputs[1])
    towards = torch.randn_like(outputs[0])
    for output in outputs:
        (output * towards).sum().backward()
    torch.testing.assert_close(inputs[0].grad, inputs[1].grad)
    for one, other in zip(folded.parameters(), plain.parameters(), strict=True):
        torch.testing.assert_close(one.grad, other.grad)


def test_first_batch_of_an_update_moves_the_statistics_and_the_update_does_not_see_it() -> None:
    torch.manual_seed(0)
    block = Block(4, 16, batch_statistics=False).train()
    conv, norm = block[0], block[1]
    images, others = 3.0 + torch.randn(6, 4, 45, 20), torch.randn(6, 4, 45, 20)
    maps = [conv(batch).detach() for batch in (images, others)]
    means = [batch.mean((0, 2, 3)) for batch in maps]
    with torch.no_grad():
        before = block(images)
    assert int(norm.num_batches_tracked) == 0
    for batch, expected in ((images, before), (others, None), (images, before)):
        # The second batch of an update moves nothing, and the third looks as the first did.
        found = block(batch)
        if expected is not None:
            torch.testing.assert_close(found, expected)
        torch.testing.assert_close(norm.running_mean, means[0], rtol=1e-4, atol=1e-5)
        torch.testing.assert_close(
            norm.running_var, maps[0].var((0, 2, 3), correction=0), rtol=1e-3, atol=1e-5
        )
    assert not torch.allclose(block.eval()(images), before)
    block.train()(others)
    # The second update: the mean of both; from the tenth on, the momentum of 0.1.
    torch.testing.assert_close(norm.running_mean, (means[0] + means[1]) / 2, rtol=1e-4, atol=1e-5)
    for _ in range(20):
        block.train()(others)
    start = norm.running_mean.clone()
    block.train()(images)
    torch.testing.assert_close(norm.running_mean, 0.9 * start + 0.1 * means[0], rtol=1e-4, atol=1e-5)


def step(block: Block) -> None:
    # Fused, it leaves the versions of tensors as they are.
    optimizer = torch.optim.Adam(block.parameters(), lr=0.1, fused=True)
    block(torch.randn(2, 4, 6, 6)).sum().backward()
    optimizer.step()


def move_statistics(block: Block) -> None:
    block[1].running_mean.lerp_(torch.ones(16), 0.5)


CHANGES = {
    "a step of an optimizer": step,
    "moving statistics": move_statistics,
    "loading": lambda block: block.load_state_dict(Block(4, 16).state_dict()),
    "a vector of parameters": lambda block: nn.utils.vector_to_parameters(
        2 * nn.utils.parameters_to_vector(block.parameters()), block.parameters()
    ),
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES.keys())
def test_acting_sees_every_change(change: Callable[[Block], object]) -> None:
    torch.manual_seed(0)
    block, images = Block(4, 16).eval(), torch.randn(3, 4, 6, 6)
    with torch.no_grad():
        before = block(images)
        torch.testing.assert_close(block(images), before, rtol=0, atol=0)
    change(block)
    with torch.no_grad():
        found, expected = block(images), nn.Sequential(*block)(images)
    torch.testing.assert_close(found, expected)
    assert not torch.allclose(found, before)


def test_a_target_network_sees_its_updates() -> None:
    torch.manual_seed(0)
    one, target = Block(4, 16, batch_statistics=False), Block(4, 16, batch_statistics=False)
    images = torch.randn(3, 4, 6, 6)
    for network in (one, target):
        with torch.no_grad():
            network.eval()(images)
    polyak_update(one.parameters(), target.parameters(), 1.0)
    with torch.no_grad():
        torch.testing.assert_close(target(images), one(images))


class Noise(gym.Env[np.ndarray, int]):
    """Images of noise, five actions, four steps; every step is worth 1."""

    observation_space = gym.spaces.Box(-3, 3, (8, 8, 2), np.float32)
    action_space = ACTIONS

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict]:
        super().reset(seed=seed)
        self.left = 4
        return self.np_random.uniform(-3, 3, (8, 8, 2)).astype(np.float32), {}

    def step(self, action: int) -> tuple[Any, float, bool, bool, dict]:
        self.left -= 1
        image = self.np_random.uniform(-3, 3, (8, 8, 2)).astype(np.float32)
        return image, 1.0, False, self.left == 0, {}


def test_the_target_of_a_dqn_with_batch_statistics_is_not_frozen() -> None:
    network = {"features_extractor_class": ConvTrunk, "net_arch": []}
    model = DQN(
        "MlpPolicy",
        Noise(),
        policy_kwargs=network,
        buffer_size=64,
        learning_starts=8,
        batch_size=8,
        target_update_interval=4,
        learning_rate=1e-2,
        seed=0,
        device="cpu",
    ).learn(40)
    images = torch.randn(3, 8, 8, 2)
    target = model.q_net_target.features_extractor
    without_cache = ConvTrunk(Noise.observation_space).eval()
    without_cache.load_state_dict(target.state_dict())
    with torch.no_grad():
        torch.testing.assert_close(target(images), without_cache(images), rtol=0, atol=0)


def test_kept_weights_follow_a_network_that_gets_another_type() -> None:
    block, images = Block(4, 16).eval(), torch.randn(3, 4, 6, 6)
    with torch.no_grad():
        before = block(images)
        found = block.double()(images.double())
    torch.testing.assert_close(found, before.double(), rtol=1e-4, atol=1e-5)


def test_second_derivatives_exist() -> None:
    block = Block(1, 16, batch_statistics=False).double().train()
    inputs = torch.randn(2, 1, 6, 6).double().requires_grad_()
    assert torch.autograd.gradgradcheck(block, inputs)


@pytest.mark.parametrize("training", [False, True])
def test_forward_is_the_textbook_formula(training: bool) -> None:
    torch.manual_seed(0)
    trunk = ConvTrunk(FRAMES).train(training)
    conv, norm = trunk.blocks[0][0], trunk.blocks[0][1]
    with torch.no_grad():
        # A negative scale turns the order of pixels round before pooling.
        norm.weight.copy_(torch.linspace(-1, 1, 16))
        norm.bias.copy_(torch.linspace(-0.5, 0.5, 16))
        norm.running_mean.fill_(0.1)
        norm.running_var.fill_(2.0)
    images = torch.randn(3, 90, 40, 4)
    found = trunk.blocks[0](images.permute(0, 3, 1, 2))
    with torch.no_grad():
        maps = conv(images.permute(0, 3, 1, 2))
        mean = maps.mean((0, 2, 3)) if training else torch.full((16,), 0.1)
        var = maps.var((0, 2, 3), correction=0) if training else torch.full((16,), 2.0)
        column = (slice(None), None, None)
        maps = (maps - mean[column]) / torch.sqrt(var[column] + norm.eps)
        maps = torch.relu(maps * norm.weight[column] + norm.bias[column])
        expected = maps.reshape(3, 16, 45, 2, 20, 2).amax((3, 5))
    torch.testing.assert_close(found, expected, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("size", [(90, 40), (45, 20), (5, 7)])
def test_fused_training_step_equals_the_layers_one_by_one(size: tuple[int, int]) -> None:
    torch.manual_seed(0)
    fused, plain = Block(4, 16).train(), Block(4, 16).train()
    with torch.no_grad():
        fused[1].weight.uniform_(0.1, 2.0)
        fused[1].bias.uniform_(-0.5, 0.5)
    plain.load_state_dict(fused.state_dict())
    images = (3.0 + torch.randn(6, 4, *size)).double()
    inputs = [images.clone().requires_grad_() for _ in range(2)]
    outputs = [fused.double()(inputs[0]), nn.Sequential(*plain.double())(inputs[1])]
    assert "NormReluPool" in type(outputs[0].grad_fn).__name__
    torch.testing.assert_close(outputs[0], outputs[1])
    towards = torch.randn_like(outputs[0])
    for output in outputs:
        (output * towards).sum().backward()
    torch.testing.assert_close(inputs[0].grad, inputs[1].grad)
    for one, other in zip(fused.parameters(), plain.parameters(), strict=True):
        torch.testing.assert_close(one.grad, other.grad)
    for name, statistic in fused.state_dict().items():
        torch.testing.assert_close(statistic, plain.state_dict()[name])


@pytest.mark.parametrize("level", [0.0, 1e3])
def test_training_step_survives_images_of_one_grey_level(level: float) -> None:
    trunk = ConvTrunk(FRAMES).train()
    trunk(torch.full((2, 90, 40, 4), level)).sum().backward()
    assert all(torch.isfinite(parameter.grad).all() for parameter in trunk.parameters())


def test_channels_first_images_give_the_same_features() -> None:
    transposed = gym.spaces.Box(0, 255, (4, 90, 40), np.uint8)
    last, first = ConvTrunk(FRAMES).eval(), ConvTrunk(transposed).eval()
    first.load_state_dict(last.state_dict())
    images = torch.randn(2, 90, 40, 4)
    torch.testing.assert_close(first(images.permute(0, 3, 1, 2).contiguous()), last(images))


def test_projected_trunk_gives_64_features_of_moderate_size() -> None:
    torch.manual_seed(0)
    trunk = ProjectedTrunk(FRAMES, batch_statistics=False)
    features = trunk(torch.randn(5, 90, 40, 4)).detach()
    assert (features.shape, trunk.features_dim) == ((5, 64), 64)
    assert 0.01 < float(features.abs().mean()) < 0.9


@pytest.mark.parametrize("shape", [(90, 40), (90, 2, 40), (3, 90, 40, 4)])
def test_refuses_what_is_no_image(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="are no images"):
        ConvTrunk(gym.spaces.Box(-1, 1, shape, np.float32))


def test_refuses_images_that_vanish_in_pooling() -> None:
    with pytest.raises(ValueError, match="at least 4 x 4 pixels, not 3 x 8"):
        ConvTrunk(gym.spaces.Box(-1, 1, (3, 8, 1), np.float32))


def test_refuses_shared_features() -> None:
    with pytest.raises(ValueError, match="share_features_extractor must be False"):
        SeparatePolicy(FRAMES, ACTIONS, lambda _: 1e-4, share_features_extractor=True)


def test_package_refuses_any_other_name() -> None:
    import usbench.agents

    spec = importlib.util.spec_from_file_location("agents", Path(usbench.agents.__file__))
    assert spec is not None and spec.loader is not None
    with pytest.raises(ImportError, match="import usbench.agents"):
        spec.loader.exec_module(importlib.util.module_from_spec(spec))
    assert "agents" not in sys.modules
