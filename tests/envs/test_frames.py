"""Frames simulated once, and found again by everything that they depend on."""

import ast
import dataclasses
import itertools
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from stored import POSES, SCENE, coded_scan

from usbench.checks import ConfigurationError
from usbench.envs import frames
from usbench.envs.bmode import Imaging
from usbench.envs.cache import sources
from usbench.envs.cache.folder import cache_folder
from usbench.envs.frames import FrameStore, frame_store
from usbench.envs.phantom import ObjectOfInterest, Phantom
from usbench.envs.pose import Pose
from usbench.envs.probe import LinearArray

pytestmark = pytest.mark.usefixtures("scans")


def test_frames_are_those_of_the_simulator_and_read_only(scans):
    store = FrameStore(*SCENE)
    frame = store.frame(POSES[0])
    assert np.array_equal(frame, coded_scan(SCENE[0], POSES[0], *SCENE[1:])) and frame.dtype == np.uint8
    assert store.frame(Pose(-5, 50, 360)) is frame and scans == [POSES[0]]
    with pytest.raises(ValueError, match="read-only"):
        frame[0, 0] = 1


def test_prepare_simulates_what_is_missing_and_tells_of_it(scans):
    store, told = FrameStore(*SCENE), []
    store.frame(POSES[1])
    store.prepare(POSES + POSES, progress=lambda *numbers: told.append(numbers))
    assert told == [(1, 2), (2, 2)] and len(scans) == 3
    store.prepare(POSES, progress=lambda *numbers: told.append(numbers))
    assert len(told) == 2 and len(scans) == 3


def test_what_was_simulated_before_an_interruption_is_kept(scans, monkeypatch):
    def interrupt(done, _):
        if done == 2:
            raise KeyboardInterrupt

    monkeypatch.setattr(frames, "_BATCH", 1)
    with pytest.raises(KeyboardInterrupt):
        FrameStore(*SCENE).prepare(POSES, interrupt)
    store = FrameStore(*SCENE)
    assert [store.has(pose) for pose in POSES] == [True, True, False] and len(scans) == 2


def test_another_process_finds_them(kept, scans):
    scans.clear()
    store = FrameStore(*SCENE)
    assert [int(store.frame(pose)[0, 0]) for pose in POSES] == [65, 70, 75]
    assert not scans
    with pytest.raises(ValueError, match="read-only"):
        store.frame(POSES[0])[0, 0] = 1


def test_what_is_new_joins_what_was_there(kept, scans):
    FrameStore(*SCENE).prepare([Pose(10, 50, 0)])
    scans.clear()
    FrameStore(*SCENE).prepare([*POSES, Pose(10, 50, 0)])
    assert not scans


def test_what_another_process_has_added_meanwhile_stays(scans):
    here, there = FrameStore(*SCENE), FrameStore(*SCENE)
    here.prepare(POSES[:1])
    there.frame(POSES[1])  # now it has read the file
    here.prepare(POSES[2:])
    there.prepare(POSES[1:2] + [Pose(20, 50, 0)])
    scans.clear()
    FrameStore(*SCENE).prepare([*POSES, Pose(20, 50, 0)])
    assert not scans


def test_the_process_shares_a_store():
    assert frame_store(*SCENE) is frame_store(Phantom(), LinearArray(), Imaging())
    assert frame_store(*SCENE) is not frame_store(Phantom(seed=1), LinearArray(), Imaging())


def variations():
    """The scene with one field changed at a time."""
    changes = [
        {"seed": 1},
        {"object_of_interest": ObjectOfInterest(x_mm=1)},
        {"object_of_interest": ObjectOfInterest(contrast=9.0)},
    ]
    changes += [
        {name: getattr(SCENE[0], name) * 1.25}
        for name in ("width_mm", "height_mm", "depth_mm", "tissue_density_per_mm3", "object_density_per_mm3")
    ] + [{"tissue_amplitude_std": 2.0}, {"attenuation_db_per_cm_mhz": 0.5}]
    for change in changes:
        yield dataclasses.replace(SCENE[0], **change), *SCENE[1:]
    for field in dataclasses.fields(LinearArray):
        value = getattr(SCENE[1], field.name)
        if value is None:
            value = {"receive_focus": 30e-3, "receive_f_number": 2.0}[field.name]
        changed = value - 1 if isinstance(value, int) else value * (1 - 1e-9)
        yield SCENE[0], dataclasses.replace(SCENE[1], **{field.name: changed}), SCENE[2]
    for name, value in {
        "dynamic_range_db": 59.999, "height_px": 91, "width_px": 41, "pixel_size": 1.0001e-3,
        "median_size": 3, "noise_db": 60.0, "tgc_db_per_cm": 1.0,
    }.items():  # fmt: skip
        yield *SCENE[:2], dataclasses.replace(SCENE[2], **{name: value})


def test_every_argument_is_in_the_key():
    assert {field.name for field in dataclasses.fields(Imaging)} == {
        "dynamic_range_db", "height_px", "width_px", "pixel_size", "median_size", "noise_db", "tgc_db_per_cm"
    }  # fmt: skip
    scenes = [SCENE, *variations()]
    assert len({FrameStore(*scene).path for scene in scenes}) == len(scenes) == 34
    assert FrameStore(*SCENE).path == FrameStore(Phantom(), LinearArray(), Imaging()).path


@dataclasses.dataclass(frozen=True)
class Strange(Phantom):
    """Tissue of a stranger, whose code may change without notice."""


@dataclasses.dataclass(frozen=True)
class StrangeObject(ObjectOfInterest):
    """An object of a stranger, in a phantom of ours."""


@dataclasses.dataclass(frozen=True)
class StrangeArray(LinearArray):
    """A transducer of a stranger."""


@pytest.mark.parametrize(
    "scene",
    [
        (Strange(), *SCENE[1:]),
        (Phantom(object_of_interest=StrangeObject()), *SCENE[1:]),
        (SCENE[0], StrangeArray(), SCENE[2]),
    ],
    ids=["tissue", "object", "array"],
)
def test_frames_of_a_strangers_classes_are_not_kept_on_disk(scans, scene):
    for n_times in (1, 2):
        FrameStore(*scene).prepare(POSES)
        assert scans == n_times * POSES


def test_frames_are_kept_while_another_thread_asks_for_more(scans, monkeypatch):
    store = FrameStore(*SCENE)
    stop = threading.Event()

    def ask():
        for angle_deg, x_mm in itertools.product(range(91, 360), range(-20, 21)):
            store.frame(Pose(x_mm, 50, angle_deg))
            if stop.is_set():
                return

    thread = threading.Thread(target=ask, daemon=True)
    thread.start()
    for angle_deg in range(0, 90, 15):
        store.prepare([Pose(0, 50, angle_deg)])
    stop.set()
    thread.join()
    assert store.path.exists()


@pytest.mark.parametrize("part", ["SIMULATOR", "ANATOMY"])
def test_the_sources_of_a_frame_are_in_the_key(monkeypatch, part):
    before = FrameStore(*SCENE).path
    monkeypatch.setattr(frames, part, "another")
    assert FrameStore(*SCENE).path != before


def test_every_source_and_library_of_a_frame_is_in_the_simulator(monkeypatch):
    found = sources.sources("scanner")
    assert {"scanner", "rf", "bmode", "phantom", "probe", "pose"} <= set(found)
    # The noise's seed is made of these words, and the poses in a file lie in this order.
    assert {"usbench.words", "usbench.coordinates"} <= set(found)
    assert frames._simulator() == frames.SIMULATOR
    of_anatomies = set(sources.sources("anatomy.simulated", "anatomy.recorded"))
    assert {"anatomy.simulated", "anatomy.recorded", "anatomy.volume"} <= of_anatomies
    for source in found.values():
        ours = [module for module in sources._imported(source) if module.startswith("usbench.")]
        assert all(sources._own_module(module) for module in ours), ours
    for name in found:
        with monkeypatch.context() as patch:
            changed = found | {name: found[name] + b"\n"}
            patch.setattr(sources, "sources", lambda *_, changed=changed: changed)
            assert frames._simulator() != frames.SIMULATOR, name
    real = sources.metadata.version
    for name in sources.LIBRARIES:
        with monkeypatch.context() as patch:
            newer = lambda asked, name=name: real(asked) + "+" * (asked == name)  # noqa: E731
            patch.setattr(sources.metadata, "version", newer)
            assert frames._simulator() != frames.SIMULATOR, name
    assert frames._simulator() == frames.SIMULATOR


def test_sources_are_followed_through_what_they_import(monkeypatch, tmp_path):
    # All ways to import, at the top and in a function; a comment is none.
    for name, text in {
        "scanner": "import usbench.envs.a\nimport numpy\n",
        "a": "from usbench.envs import b, c\n",
        "b": "def f():\n    from usbench.envs.d import g\n",
        "c": "from usbench.envs.a import h\n",
        "d": "# from usbench.envs.e import i\n",
        "e": "",
    }.items():
        (tmp_path / f"{name}.py").write_text(text)
    monkeypatch.setattr(sources, "__file__", str(tmp_path / "cache" / "sources.py"))
    assert set(sources.sources("scanner")) == {"scanner", "a", "b", "c", "d"}


def test_every_library_that_a_source_imports_has_its_version_in_the_key():
    known = {"numpy", "scipy", "numba", "llvmlite", "cv2"}
    assert {name.replace("opencv-python-headless", "cv2") for name in sources.LIBRARIES} == known
    for name, source in sources.sources("scanner").items():
        for node in ast.walk(ast.parse(source)):
            modules = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            modules += [node.module] if isinstance(node, ast.ImportFrom) else []
            tops = {module.split(".")[0] for module in modules} - set(sys.stdlib_module_names)
            # platformdirs decides where files lie, the others what is told: nothing of what is in them.
            assert tops <= known | {"usbench", "platformdirs", "pydantic", "rich"}, name


def test_sources_that_change_under_a_running_process_keep_nothing(monkeypatch):
    # What it computes is from the old ones, under whatever key.
    monkeypatch.setattr(frames, "_simulator", lambda: "edited since")
    store = FrameStore(*SCENE)
    with pytest.warns(UserWarning, match="sources have changed since they were imported"):
        store.prepare(POSES)
    assert not store.path.exists() and store.frame(POSES[0])[0, 0] == 65


def test_the_folder_can_be_set(monkeypatch, tmp_path):
    monkeypatch.setenv("USBENCH_CACHE", str(tmp_path / "elsewhere"))
    store = FrameStore(*SCENE)
    store.prepare(POSES)
    assert store.path.parent == tmp_path / "elsewhere" == cache_folder() and store.path.is_file()
    monkeypatch.setenv("USBENCH_CACHE", "~nobody at all/frames")
    with pytest.raises(ConfigurationError, match="USBENCH_CACHE must name a folder, not '~nobody at all"):
        cache_folder()
    monkeypatch.setenv("USBENCH_CACHE", "~/frames")
    assert cache_folder() == Path.home() / "frames"
    monkeypatch.delenv("USBENCH_CACHE")
    assert cache_folder().name == "usbench" and cache_folder().is_absolute()


def test_digest_tells_frames_and_their_order_apart():
    store = FrameStore(*SCENE)
    digest = store.digest(POSES)
    assert digest == FrameStore(*SCENE).digest(POSES) and len(digest) == 64
    assert digest != store.digest(POSES[::-1]) and digest != store.digest(POSES[:2])
    assert digest != FrameStore(Phantom(seed=1), *SCENE[1:]).digest(POSES)
