"""Files written whole or not at all."""

import os
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from usbench.atomic import atomic_file, move_whole, remove_leftovers, scratch_folder


def test_failed_write_leaves_the_old_file_and_no_leftover(tmp_path):
    path = tmp_path / "file"
    path.write_bytes(b"old")
    with pytest.raises(RuntimeError), atomic_file(path) as file:
        file.write(b"half")
        raise RuntimeError
    assert path.read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["file"]


def test_files_of_several_threads_have_the_rights_that_the_process_gives(tmp_path, monkeypatch):
    ask = os.umask
    before = ask(0o027)

    def slow(mask):
        found = ask(mask)
        time.sleep(0.001)  # others come between
        return found

    monkeypatch.setattr(os, "umask", slow)

    def write(number):
        with atomic_file(tmp_path / str(number)) as file:
            file.write(b"whole")

    try:
        with ThreadPoolExecutor(8) as pool:
            list(pool.map(write, range(40)))
        assert ask(0o027) == 0o027
    finally:
        ask(before)
    assert {path.stat().st_mode & 0o777 for path in tmp_path.iterdir()} == {0o640}


def test_scratch_folder_is_gone_afterwards_and_what_was_moved_stays(tmp_path):
    with pytest.raises(RuntimeError), scratch_folder(tmp_path / "model") as scratch:
        (scratch / "model.a").write_bytes(b"whole")
        (scratch / "model.b").write_bytes(b"half")
        move_whole(scratch / "model.a", tmp_path / "model.a")
        raise RuntimeError
    assert os.listdir(tmp_path) == ["model.a"]


@pytest.mark.parametrize("writer", [atomic_file, scratch_folder])
def test_errors_name_the_file_that_was_asked_for(writer, tmp_path):
    path = tmp_path / "missing" / "file"
    with pytest.raises(FileNotFoundError) as refused, writer(path):
        pass
    assert refused.value.filename == str(path)


def test_folder_is_moved_in_place_of_a_folder(tmp_path):
    for name in ("old", "new"):
        (tmp_path / name).mkdir()
        (tmp_path / name / name).touch()
    move_whole(tmp_path / "new", tmp_path / "old")
    assert os.listdir(tmp_path) == ["old"] and os.listdir(tmp_path / "old") == ["new"]


def test_written_file_has_the_usual_permissions(tmp_path):
    (tmp_path / "usual").write_bytes(b"")
    with atomic_file(tmp_path / "file") as file:
        file.write(b"new")
    assert (tmp_path / "file").stat().st_mode == (tmp_path / "usual").stat().st_mode
    assert (tmp_path / "file").read_bytes() == b"new"


def test_what_a_killed_writer_left_is_removed_by_a_later_one(tmp_path):
    old, new, other = (tmp_path / name for name in (".file.abc.part", ".file.def.part", ".other.abc.part"))
    for path in (old, new, other):
        path.touch()
    for path in (old, other):
        os.utime(path, (time.time() - 7200, time.time() - 7200))
    with atomic_file(tmp_path / "file") as file:
        file.write(b"new")
    # Another process may be writing the newer one; the third is no business of this file's.
    assert sorted(os.listdir(tmp_path)) == [".file.def.part", ".other.abc.part", "file"]
    remove_leftovers(tmp_path)
    assert os.listdir(tmp_path) == ["file"]
