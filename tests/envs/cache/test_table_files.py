"""Tables on disk: found again by all that they follow from, made again when in doubt, limited and listed."""

import dataclasses
import multiprocessing
import os
import stat

import numpy as np
import numpy.typing as npt
import pytest
from bomb import Bomb

from usbench import atomic
from usbench.envs.cache import sources, table_files
from usbench.envs.cache.table_files import TABLES, on_disk
from usbench.envs.field import elevation, response_table
from usbench.envs.probe import LinearArray
from usbench.envs.rf import simulate_iq
from usbench.words import in_words

ARRAY = LinearArray(n_elements=24, n_active=16, n_lines=8)
SCENE = "a ramp of 7 numbers"


@dataclasses.dataclass(frozen=True)
class Ramp:
    """A small table."""

    values: npt.NDArray[np.float32]
    step: float
    places: npt.NDArray[np.int64]


@pytest.fixture(autouse=True)
def folder(monkeypatch, tmp_path):
    """A cache of this test alone."""
    monkeypatch.setenv("USBENCH_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture
def made():
    """How often the ramp was made."""
    return []


def ramp(made, scene=SCENE):
    def make():
        made.append(scene)
        return Ramp(np.arange(7, dtype=np.float32), 0.25, np.zeros((2, 0, 3), np.int64))

    return on_disk(LinearArray(), Ramp, scene, make)


@pytest.fixture
def kept(made):
    """The file of the ramp."""
    ramp(made)
    made.clear()
    (entry,) = table_files.entries()
    return entry.path


def check_made_again(made, words):
    with pytest.warns(UserWarning, match=f"a table is made again, as .* cannot be used: .*{words}"):
        found = ramp(made)
    assert made == [SCENE] and np.array_equal(found.values, np.arange(7))
    ramp(made)  # and the file is good again
    assert made == [SCENE]


def test_a_second_one_is_mapped_and_has_the_same_values(made):
    one, other = ramp(made), ramp(made)
    assert made == [SCENE]
    assert np.array_equal(one.values, other.values) and other.values.dtype == np.float32
    assert other.step == 0.25 and isinstance(other.step, float)
    assert other.places.shape == (2, 0, 3) and other.places.dtype == np.int64
    assert other.values.ctypes.data % 64 == 0  # whole vectors
    assert other.values.flags.writeable and not other.values.flags.owndata


def test_what_is_written_to_a_table_does_not_reach_the_file(made, kept):
    before = kept.read_bytes()
    ramp(made).values[:] = -1
    assert kept.read_bytes() == before and np.array_equal(ramp(made).values, np.arange(7)) and not made


def test_another_scene_or_code_is_another_file(made, kept, monkeypatch):
    ramp(made, "another ramp")
    assert made == ["another ramp"]
    monkeypatch.setattr(table_files, "CODE", "another")
    monkeypatch.setattr(table_files, "_code", lambda: "another")
    ramp(made)
    assert made == ["another ramp", SCENE] and len(table_files.entries()) == 3


def test_every_source_of_a_table_is_in_its_key(monkeypatch):
    found = sources.sources("field.response_table")
    assert {"probe", "field.aperture", "field.elevation", "field.receive", "field.waveforms"} <= set(found)
    assert table_files._code() == table_files.CODE
    for name in found:
        changed = found | {name: found[name] + b"\n"}
        monkeypatch.setattr(sources, "sources", lambda *_, changed=changed: changed)
        assert table_files._code() != table_files.CODE, name


def test_the_processor_that_numba_compiles_for_is_in_its_key(monkeypatch):
    for key in ("NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES"):
        monkeypatch.delenv(key, raising=False)
    found = {sources.code_hash("field.response_table")}
    for key, value in (("NUMBA_CPU_NAME", "generic"), ("NUMBA_CPU_FEATURES", "+avx")):
        monkeypatch.setenv(key, value)
        found.add(sources.code_hash("field.response_table"))
    assert len(found) == 3


# Files that are not to be trusted


@pytest.mark.parametrize("size", [0, 10, 200, -1])
def test_a_truncated_file(made, kept, size):
    data = kept.read_bytes()
    kept.unlink()  # what is mapped stays
    kept.write_bytes(data[:size])
    check_made_again(made, "")


@pytest.mark.parametrize("part", [np.arange(7, dtype=np.float32).tobytes(), SCENE.encode(), b"values"])
def test_a_damaged_file(made, kept, part):
    data = bytearray(kept.read_bytes())
    data[data.index(part) + len(part) - 1] ^= 0xFF
    kept.unlink()
    kept.write_bytes(bytes(data))
    check_made_again(made, "")


@pytest.mark.parametrize("content", [b"not a table", b"\x93NUMPY", b"PK\x03\x04"])
def test_a_foreign_file(made, kept, content):
    kept.write_bytes(content)
    check_made_again(made, "")


def test_arrays_of_something_else(made, kept):
    np.save(kept, np.zeros(3))
    check_made_again(made, "it is no table")


def test_a_good_file_of_another_table_under_this_name(made, kept):
    ramp(made, "another ramp")
    made.clear()
    other = next(entry.path for entry in table_files.entries() if entry.path != kept)
    os.replace(other, kept)
    check_made_again(made, "its checksum is wrong")


def test_pickled_objects_are_not_opened(made, kept, tmp_path):
    np.save(kept, np.array([Bomb(tmp_path / "exploded")], dtype=object), allow_pickle=True)
    check_made_again(made, "")
    assert not (tmp_path / "exploded").exists()


def test_a_folder_that_cannot_be_written(monkeypatch, tmp_path, made):
    (tmp_path / "file").write_text("in the way")  # permissions would not stop root
    monkeypatch.setenv("USBENCH_CACHE", str(tmp_path / "file" / "cache"))
    with pytest.warns(UserWarning, match="tables are not kept on disk, as .*cache. takes none .Not a dir"):
        assert ramp(made).step == 0.25


def test_a_full_disk_leaves_no_debris(monkeypatch, made, kept):
    def full(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(atomic.os, "fsync", full)
    with pytest.warns(UserWarning, match="tables are not kept on disk, .*No space left"):
        ramp(made, "another ramp")
    assert list(kept.parent.iterdir()) == [kept]


def test_sources_that_change_under_a_running_process_keep_nothing(monkeypatch, made):
    monkeypatch.setattr(table_files, "_code", lambda: "edited since")
    with pytest.warns(UserWarning, match="sources have changed since they were imported"):
        ramp(made)
    assert not table_files.entries()


# The folder


def test_what_one_user_has_made_others_can_read(made):
    previous = os.umask(0o027)
    try:
        ramp(made)
    finally:
        os.umask(previous)
    (entry,) = table_files.entries()
    assert stat.S_IMODE(entry.path.stat().st_mode) == 0o640


def test_the_folder_is_limited_and_what_was_used_last_stays(monkeypatch, made, folder):
    paths = []
    for age, scene in zip((400, 300, 200), "abc", strict=True):
        ramp(made, scene)
        (path,) = {entry.path for entry in table_files.entries()} - set(paths)
        paths.append(path)
        os.utime(path, times=(1e9 - age, 1e9 - age))
    foreign = folder / "notes.npy"
    foreign.write_text("not ours")
    ramp(made, "a")  # the oldest is read: now it is the newest
    monkeypatch.setattr(table_files, "MAX_BYTES", int(2.5 * paths[0].stat().st_size))
    ramp(made, "d")
    assert [path.exists() for path in paths] == [True, False, False] and foreign.exists()


def test_a_table_above_the_limit_is_not_kept(monkeypatch, made):
    monkeypatch.setattr(table_files, "MAX_BYTES", 10)
    ramp(made)
    assert not table_files.entries()


def test_what_a_killed_process_left_behind_is_dropped(made, kept):
    old, new = kept.with_name(".table-old.npy.x.part"), kept.with_name(".table-new.npy.x.part")
    for path in (old, new):
        path.write_bytes(b"half a file")
    os.utime(old, times=(1e9, 1e9))
    ramp(made, "another ramp")
    assert not old.exists() and new.exists()


def test_entries_tell_what_the_files_are_and_clear_removes_them(made, kept):
    foreign = kept.with_name("table.txt")
    foreign.write_text("not ours")
    (entry,) = table_files.entries()
    assert entry.contents.scene == SCENE and entry.contents.code == table_files.CODE
    assert entry.size == kept.stat().st_size
    kept.write_bytes(b"not a table")
    (entry,) = table_files.entries()
    assert entry.contents is None
    assert TABLES.clear() == (1, 11) and list(foreign.parent.iterdir()) == [foreign]


# The simulator's tables


def _rf(seed=0):
    rng = np.random.default_rng(seed)
    points = rng.uniform([-5e-3, -2e-3, 5e-3], [5e-3, 2e-3, 30e-3], (400, 3))
    return simulate_iq(points, rng.normal(size=400), ARRAY, 15e-3)[0]


def _forget():
    response_table.forget_tables()
    elevation.elevation_taps.cache_clear()


def test_rf_from_tables_on_disk_has_the_same_bits(monkeypatch):
    _forget()
    first = _rf()
    scenes = sorted(entry.contents.scene.split(",")[0] for entry in table_files.entries())
    assert scenes == ["elevation", "responses"]
    assert all(in_words(ARRAY) in entry.contents.scene for entry in table_files.entries())

    def unexpected(*_):
        raise AssertionError("made again")

    monkeypatch.setattr(response_table, "_made", unexpected)
    monkeypatch.setattr(elevation, "_fitted", unexpected)
    _forget()
    assert _rf().tobytes() == first.tobytes()


def _rf_of_a_process(barrier, results):
    barrier.wait(60)
    results.put(_rf().tobytes())


@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
@pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="no fork on this platform")
def test_processes_that_start_at_once_agree(folder):
    _forget()
    context = multiprocessing.get_context("fork")
    barrier, results = context.Barrier(2), context.Queue()
    children = [context.Process(target=_rf_of_a_process, args=(barrier, results)) for _ in range(2)]
    for child in children:
        child.start()
    found = {results.get(timeout=60) for _ in children}
    for child in children:
        child.join(60)
    assert len(found) == 1 and len(list(folder.iterdir())) == 2
