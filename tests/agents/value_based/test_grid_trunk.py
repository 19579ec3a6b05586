"""The trunk of double DQN: its features tell places, and its grid and norms are those asked for."""

import numpy as np
import pytest
import torch
from gymnasium import spaces

from usbench.agents.value_based.grid_trunk import GridTrunk


def test_trunk_tells_where_something_is():
    torch.manual_seed(0)
    trunk = GridTrunk(spaces.Box(-3, 3, (90, 40, 1), np.float32))
    image = torch.zeros(1, 90, 40, 1)
    image[0, 40:50, 4:10] = 3.0
    with torch.no_grad():
        left, right = trunk(image), trunk(image.flip(2))
    assert left.shape == (1, 720)
    assert (left - right).abs().max() > 0.1 * left.abs().max()


@pytest.mark.parametrize(("groups", "names"), [(4, "GroupNorm"), (1, "GroupNorm"), (0, "")])
def test_trunk_has_another_grid_and_another_norm_where_asked(groups, names):
    trunk = GridTrunk(spaces.Box(-3, 3, (90, 40, 2), np.float32), grid=(2, 1), groups=groups)
    assert trunk(torch.zeros(3, 90, 40, 2)).shape == (3, trunk.features_dim) == (3, 2 * 48)
    found = {type(one).__name__ for one in trunk.modules() if "Norm" in type(one).__name__}
    assert found - {"NormalizedResidual"} == ({names} if names else set())
    # Wu and He (2018), Section 3.1: with one group it is layer norm.
    if groups == 1:
        norm = next(one for one in trunk.modules() if isinstance(one, torch.nn.GroupNorm))
        values = torch.randn(2, 16, 4, 4)
        expected = torch.nn.functional.layer_norm(values, (16, 4, 4))
        torch.testing.assert_close(norm(values), expected)


def test_trunk_refuses_images_that_are_too_small():
    with pytest.raises(ValueError, match="images must have at least 8 x 8 pixels, not 7 x 40"):
        GridTrunk(spaces.Box(-3, 3, (7, 40, 2), np.float32))
