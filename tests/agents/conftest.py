"""What the tests of the agents share: one thread, and the modules beside them."""

import pytest
import torch


@pytest.fixture(autouse=True)
def _one_thread() -> None:
    torch.set_num_threads(1)
