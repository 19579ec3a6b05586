"""`usbench cache`: what is kept on disk, and that nothing is."""

import numpy as np
import pytest

from usbench import cli
from usbench.envs import frames, scanner
from usbench.envs.bmode import Imaging
from usbench.envs.cache import frame_files, table_files
from usbench.envs.phantom import Phantom
from usbench.envs.pose import Pose
from usbench.envs.probe import LinearArray


@pytest.fixture
def folder(monkeypatch, tmp_path):
    """A cache of this test alone, with three frames of one phantom."""
    monkeypatch.setenv("USBENCH_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("COLUMNS", "120")
    monkeypatch.setattr(scanner, "scan", lambda *_: np.zeros((90, 40), np.uint8))
    store = frames.FrameStore(Phantom(seed=7), LinearArray(), Imaging())
    store.prepare([Pose(x, 50, 0) for x in (-5, 0, 5)])
    return tmp_path / "cache"


def shown(capsys, *argv):
    """The lines that the command prints on stdout, runs of blanks as one."""
    assert cli.main(["cache", *argv]) == 0
    captured = capsys.readouterr()
    assert captured.err == ""
    return [" ".join(line.split()) for line in captured.out.splitlines()]


def test_shows_place_size_limit_and_what_each_file_is(capsys, folder):
    lines = shown(capsys)
    assert lines[0] == f"folder: {folder}"
    assert lines[1] == "frames: 1 file, 0.0 MB of at most 250 MB"
    assert lines[2] == "tables: 0 files, 0.0 MB of at most 1000 MB"
    (row,) = [line for line in lines if "Phantom" in line]
    assert "│ 3 frames │ 0.0 MB │" in row
    assert row.endswith("│ this │ Phantom(seed=7), default array, default imaging │")


def test_tells_frames_of_another_simulator_apart(capsys, folder, monkeypatch):
    monkeypatch.setattr(frames, "SIMULATOR", "changed since")
    (row,) = [line for line in shown(capsys) if "Phantom" in line]
    assert "│ another │" in row


def test_a_file_that_is_not_readable_is_shown_and_cleared(capsys, folder):
    (folder / "frames-0.npz").write_bytes(b"not a frame")
    assert any("not readable" in line for line in shown(capsys))
    assert shown(capsys, "--clear")[0].startswith("removed 2 files")


def test_tables_are_listed_and_cleared_too(capsys, folder, monkeypatch):
    path = table_files.TABLES.path("f" * 64)
    table_files.write(
        path, table_files.Contents("depth 0.0943021 m, Probe()", table_files.CODE, {"a": np.ones(3)})
    )
    lines = shown(capsys)
    assert lines[2].startswith("tables: 1 file, 0.0 MB")
    (row,) = [line for line in lines if "depth" in line]
    assert row.startswith("│ a table │ 0.0 MB │") and row.endswith("│ this │ depth 0.0943 m, default probe │")
    monkeypatch.setattr(table_files, "CODE", "changed since")
    (row,) = [line for line in shown(capsys) if "depth" in line]
    assert "│ another │" in row
    path.write_bytes(b"not a table")
    assert any("not readable" in line for line in shown(capsys))
    assert shown(capsys, "--clear")[0].startswith("removed 2 files")
    assert not list(folder.iterdir())


def test_clear(capsys, folder):
    size = frame_files.entries()[0].size
    assert shown(capsys, "--clear") == [f"removed 1 file ({size / 1e6:.1f} MB) from {folder}"]
    empty = ["frames: 0 files, 0.0 MB of at most 250 MB", "tables: 0 files, 0.0 MB of at most 1000 MB"]
    assert shown(capsys) == [f"folder: {folder}", *empty]
    assert shown(capsys, "--clear") == [f"removed 0 files (0.0 MB) from {folder}"]


def test_a_folder_that_is_not_there_holds_nothing(capsys, monkeypatch, tmp_path):
    monkeypatch.setenv("USBENCH_CACHE", str(tmp_path / "nowhere"))
    assert shown(capsys)[1] == "frames: 0 files, 0.0 MB of at most 250 MB"
    assert not (tmp_path / "nowhere").exists()
