"""What the tests of the agents share: one thread, and the modules beside them."""

import sys
from pathlib import Path

import pytest
import torch

sys.path.insert(0, str(Path(__file__).parent))  # for `import signs`; pytest's importlib mode does not do it


@pytest.fixture(autouse=True)
def _one_thread() -> None:
    torch.set_num_threads(1)
