"""What the tests of the physics share: the data of tests/reference, and frames."""

from pathlib import Path

import numpy as np
import pytest

REFERENCE = Path(__file__).parents[1] / "reference"
# All lines of the reference; it lies beside the repository of those who develop it.
FULL_REFERENCE = Path(__file__).parents[3] / "shared" / "reference" / "rf_reference.npz"
REFERENCES = {"extract": REFERENCE / "rf_reference.npz"}
if FULL_REFERENCE.exists():
    REFERENCES["full"] = FULL_REFERENCE


@pytest.fixture
def coded(monkeypatch):
    """Frames that tell their pose, in place of the simulator's."""
    from coded import CodedFrames

    monkeypatch.setattr("usbench.envs.guidance.frame_store", lambda *_: CodedFrames())


@pytest.fixture(scope="session")
def kept_frames():
    """Simulate the frames from the poses that it is called with once, for every process of the session."""
    from usbench.envs.bmode import Imaging
    from usbench.envs.frames import frame_store
    from usbench.envs.phantom import Phantom
    from usbench.envs.probe import LinearArray

    return frame_store(Phantom(), LinearArray(), Imaging()).prepare


@pytest.fixture
def scans(monkeypatch, tmp_path):
    """A cache of this test alone, and the list of what was simulated."""
    from stored import coded_scan, fresh_stores

    calls = []

    def scan(phantom, pose, array, imaging):
        calls.append(pose)
        return coded_scan(phantom, pose, array, imaging)

    monkeypatch.setenv("USBENCH_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("USBENCH_THREADS", "1")  # for the order of the calls
    for module in ("frames", "scanner"):  # one by one, and in batches
        monkeypatch.setattr(f"usbench.envs.{module}.scan", scan)
    # The stores that the whole process shares must neither have frames of the simulator, nor keep these.
    fresh_stores(monkeypatch)
    yield calls


@pytest.fixture
def kept(scans):
    """The file of a store whose frames are on disk."""
    from stored import POSES, SCENE

    from usbench.envs.frames import FrameStore

    store = FrameStore(*SCENE)
    store.prepare(POSES)
    return store.path


@pytest.fixture
def with_table(monkeypatch):
    """Lines are summed with a table of responses however few the scatterers are, as those of frames are."""
    monkeypatch.setattr("usbench.envs.rf.FEW_PAIRS", 0)


@pytest.fixture(scope="session")
def reference():
    """RF from two independent codes, see tests/reference/README.md."""
    with np.load(REFERENCES["extract"]) as file:
        return dict(file)


@pytest.fixture(scope="session", params=REFERENCES)
def reference_lines(request):
    """The same, and again with all of its lines where they are there."""
    with np.load(REFERENCES[request.param]) as file:
        return dict(file)


@pytest.fixture
def image(tmp_path):
    """`image(value, size, ..)`: the file of a volume that is a function of the world, see volumes.py."""
    import SimpleITK as sitk
    from volumes import of_world

    def make(value, *args, **kwargs):
        sitk.WriteImage(of_world(value, *args, **kwargs), str(tmp_path / "image.mha"))
        return tmp_path / "image.mha"

    return make


@pytest.fixture(scope="session")
def tissue_file(tmp_path_factory):
    """80 x 60 x 90 mm of tissue, 60 .. 140 from left to right."""
    from volumes import block

    return block(tmp_path_factory.mktemp("volumes") / "block.mha")
