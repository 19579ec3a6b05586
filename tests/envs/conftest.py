"""What the tests of the physics share: the reference outside the repository, and the exact model."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))  # for `import exact`; pytest's importlib mode does not do it

SHARED = Path(__file__).parents[3] / "shared"


def shared_file(name):
    """Path of a file beside the repository, or skip the test."""
    path = SHARED / name
    if not path.exists():
        pytest.skip(f"needs ../shared/{name}, which lies beside the repository of its developers only")
    return path


@pytest.fixture(scope="session")
def reference():
    """RF from two independent codes, see ../shared/reference/README.md."""
    with np.load(shared_file("reference/rf_reference.npz")) as file:
        return dict(file)


@pytest.fixture(scope="session")
def plus():
    """Folder with the real RF frame of the PLUS toolkit."""
    return shared_file("data/plus/README.md").parent
