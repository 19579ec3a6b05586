"""Files of frames: never served when in doubt, whole with several processes, limited and listed."""

import multiprocessing
import os
import stat
import warnings

import numpy as np
import pytest
from bomb import Bomb
from stored import POSES, SCENE, coded_scan

from usbench import atomic
from usbench.envs import frames
from usbench.envs.cache import frame_files
from usbench.envs.frames import FrameStore
from usbench.envs.phantom import ObjectOfInterest, Phantom
from usbench.envs.pose import Pose
from usbench.envs.probe import LinearArray

pytestmark = pytest.mark.usefixtures("scans")


def check_simulated_again(scans, words):
    """A new store distrusts the file, says so, and still serves the right frames."""
    scans.clear()
    store = FrameStore(*SCENE)
    with pytest.warns(UserWarning, match=words):
        store.prepare(POSES)
    assert scans == POSES
    for pose in POSES:
        assert np.array_equal(store.frame(pose), coded_scan(SCENE[0], pose, *SCENE[1:]))
    scans.clear()
    FrameStore(*SCENE).prepare(POSES)  # and the file is good again
    assert not scans


# Files that are not to be trusted


@pytest.mark.parametrize("size", [0, 10, 1000, -1])
def test_a_truncated_file(kept, scans, size):
    data = kept.read_bytes()
    kept.write_bytes(data[:size])
    check_simulated_again(scans, "frames are simulated again, as .* cannot be used")


def test_a_damaged_file(kept, scans):
    data = bytearray(kept.read_bytes())
    data[len(data) // 2] ^= 0xFF
    kept.write_bytes(bytes(data))
    check_simulated_again(scans, "cannot be used")


@pytest.mark.parametrize("content", [b"not a frame", b"\x93NUMPY", b"PK\x03\x04"])
def test_a_foreign_file(kept, scans, content):
    kept.write_bytes(content)
    check_simulated_again(scans, "cannot be used")


def test_arrays_of_something_else(kept, scans):
    np.savez(kept, images=np.zeros((3, 90, 40), np.uint8))
    check_simulated_again(scans, "cannot be used")


def test_a_wrong_checksum(kept, scans):
    with np.load(kept) as file:
        content = dict(file)
    content["frames"] = content["frames"] + 1
    np.savez(kept, **content)
    check_simulated_again(scans, "its checksum is wrong")


def test_a_good_file_of_another_scene_under_this_name(kept, scans):
    other = FrameStore(Phantom(seed=7), *SCENE[1:])
    other.prepare(POSES)
    os.replace(other.path, kept)
    check_simulated_again(scans, "its checksum is wrong")


def test_pickled_objects_are_not_opened(kept, scans, tmp_path):
    bombs = np.array([Bomb(tmp_path / "exploded")], dtype=object)
    np.savez(kept, poses=bombs, frames=bombs, checksum=bombs)
    check_simulated_again(scans, "cannot be used")
    assert not (tmp_path / "exploded").exists()


def test_a_folder_in_the_place_of_the_file(kept, scans):
    kept.unlink()
    kept.mkdir()
    store = FrameStore(*SCENE)
    with pytest.warns(UserWarning) as caught:
        store.prepare(POSES)
    assert [str(warning.message).split(",")[0].split(":")[0] for warning in caught] == [
        "frames are simulated again",
        "frames are not kept on disk",
    ]
    assert store.frame(POSES[0])[0, 0] == 65


def test_a_folder_that_cannot_be_written(monkeypatch, tmp_path, scans):
    (tmp_path / "file").write_text("in the way")  # permissions would not stop root
    monkeypatch.setenv("USBENCH_CACHE", str(tmp_path / "file" / "cache"))
    store = FrameStore(*SCENE)
    with pytest.warns(UserWarning, match="frames are not kept on disk, as .*cache. takes none .Not a dir"):
        store.prepare(POSES)
    assert scans == POSES and [int(store.frame(pose)[0, 0]) for pose in POSES] == [65, 70, 75]


def test_a_full_disk_leaves_no_debris(monkeypatch, kept):
    def full(_):
        raise OSError(28, "No space left on device")

    before = kept.read_bytes()
    monkeypatch.setattr(atomic.os, "fsync", full)
    with pytest.warns(UserWarning, match="frames are not kept on disk, .*No space left"):
        FrameStore(*SCENE).prepare([Pose(15, 50, 0)])
    assert list(kept.parent.iterdir()) == [kept] and kept.read_bytes() == before


# Several processes, and the size of the folder


def _prepare(poses, barrier):
    barrier.wait(30)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for _ in range(5):
            FrameStore(*SCENE).prepare(poses)


@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
@pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="no fork on this platform")
def test_processes_that_start_at_once(scans):
    context = multiprocessing.get_context("fork")
    barrier = context.Barrier(3)
    groups = [[Pose(x, 50, angle) for x in range(-20, 21, 5)] for angle in (0, 15, 30)]
    children = [context.Process(target=_prepare, args=(group, barrier)) for group in groups]
    for child in children:
        child.start()
    for child in children:
        child.join(60)
    assert [child.exitcode for child in children] == [0, 0, 0]
    store = FrameStore(*SCENE)
    assert list(store.path.parent.iterdir()) == [store.path]  # one file, no debris
    store.prepare(sum(groups, []))
    for pose in groups[0]:
        assert store.frame(pose)[0, 0] == (pose.x_mm + 70) % 256


def test_the_folder_is_limited_and_what_was_used_last_stays(monkeypatch):
    stores = [FrameStore(Phantom(seed=seed), *SCENE[1:]) for seed in range(4)]
    for age, store in zip((400, 300, 200), stores[:3], strict=True):
        store.prepare(POSES)
        os.utime(store.path, times=(1e9 - age, 1e9 - age))
    foreign = stores[0].path.with_name("notes.txt")
    foreign.write_text("not ours")
    FrameStore(Phantom(seed=0), *SCENE[1:]).frame(POSES[0])  # the oldest is read: now it is the newest
    monkeypatch.setattr(frame_files, "MAX_BYTES", int(2.5 * stores[0].path.stat().st_size))
    stores[3].prepare(POSES)
    assert [store.path.exists() for store in stores] == [True, False, False, True]
    assert foreign.exists()


def test_what_one_user_has_simulated_others_can_read(scans):
    """With one cache for a lab, a private file would make everybody simulate everything again."""
    previous = os.umask(0o027)
    try:
        store = FrameStore(*SCENE)
        store.prepare(POSES)
    finally:
        os.umask(previous)
    assert stat.S_IMODE(store.path.stat().st_mode) == 0o640


def test_a_file_larger_than_the_limit_stays(monkeypatch, kept, scans):
    monkeypatch.setattr(frame_files, "MAX_BYTES", 1)
    FrameStore(*SCENE).prepare([Pose(20, 50, 0)])
    assert kept.exists()


def test_what_a_killed_process_left_behind_is_dropped_and_what_is_being_written_is_not(kept):
    old, new = kept.with_name(".frames-old.npz.x.part"), kept.with_name(".frames-new.npz.x.part")
    foreign = kept.with_name(".notes.x.part")
    for path in (old, new, foreign):
        path.write_bytes(b"half a file")
    for path in (old, foreign):
        os.utime(path, times=(1e9, 1e9))
    FrameStore(*SCENE).prepare([Pose(20, 50, 0)])
    assert not old.exists() and new.exists() and foreign.exists()


def _prepare_and_die(poses):
    # In the middle of a file, as of `kill -9` or a power cut.
    os.fsync = lambda _: os._exit(9)
    FrameStore(*SCENE).prepare(poses)


@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
@pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="no fork on this platform")
def test_a_process_killed_while_it_writes_harms_nothing(kept):
    before = kept.read_bytes()
    context = multiprocessing.get_context("fork")
    child = context.Process(target=_prepare_and_die, args=([Pose(15, 50, 0)],))
    child.start()
    child.join(60)
    assert child.exitcode == 9 and kept.read_bytes() == before
    assert len(list(kept.parent.glob(".frames-*.part"))) == 1


# What the folder holds


def test_entries_tell_what_the_files_are(kept):
    scene = (Phantom(seed=3, object_of_interest=ObjectOfInterest(x_mm=1)), LinearArray(n_active=32), SCENE[2])
    FrameStore(*scene).prepare(POSES[:2])
    os.utime(kept, times=(1e9, 1e9))
    newest, oldest = frame_files.entries()
    assert newest.path == FrameStore(*scene).path and oldest.path == kept and oldest.used == 1e9
    assert newest.contents.scene == (
        "Phantom(seed=3, object_of_interest=ObjectOfInterest(x_mm=1)) LinearArray(n_active=32) Imaging()"
    )
    assert oldest.contents.scene == "Phantom() LinearArray() Imaging()"
    assert newest.contents.simulator == frames.SIMULATOR
    assert [len(entry.contents.frames) for entry in (newest, oldest)] == [2, 3]
    assert oldest.size == kept.stat().st_size


def test_a_damaged_file_is_listed_as_such(kept):
    kept.write_bytes(b"not a frame")
    (entry,) = frame_files.entries()
    assert entry.contents is None and entry.size == 11


def test_no_folder_holds_nothing():
    assert frame_files.entries() == [] and frame_files.FRAMES.clear() == (0, 0)


def test_clear_removes_frames_and_nothing_else(kept, scans):
    foreign, writing = kept.with_name("notes.npz"), kept.with_name(".frames-new.npz.x.part")
    for path in (foreign, writing):
        path.write_bytes(b"...")
    size = kept.stat().st_size
    assert frame_files.FRAMES.clear() == (1, size)
    assert sorted(kept.parent.iterdir()) == sorted([foreign, writing])
    scans.clear()
    FrameStore(*SCENE).prepare(POSES)
    assert scans == POSES
