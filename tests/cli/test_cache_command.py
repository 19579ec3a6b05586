"""`usbench cache`: what is kept on disk, and that nothing is."""

import numpy as np
import pytest

from usbench import cli
from usbench.envs import frames, scanner
from usbench.envs.bmode import Imaging
from usbench.envs.cache import frame_files, table_files
from usbench.envs.phantom import ObjectOfInterest, Phantom
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


def test_shows_place_size_and_limit_in_three_lines(capsys, folder):
    assert shown(capsys) == [
        f"folder: {folder}",
        "frames: 1 file, 0.0 MB of at most 250 MB",
        "tables: 0 files, 0.0 MB of at most 1000 MB",
    ]


def test_files_shows_what_each_is(capsys, folder):
    lines = shown(capsys, "--files")
    assert lines[:3] == shown(capsys)
    assert lines[3].startswith("3 frames, 0.0 MB, last used 2")
    assert lines[4:] == ["Phantom(seed=7), default array, default imaging"]


def test_what_a_file_holds_is_broken_to_the_width_of_the_terminal(capsys, folder, monkeypatch):
    drawn = Phantom(seed=5, object_of_interest=ObjectOfInterest(depth_mm=60, angle_deg=60, contrast=17.5))
    frames.FrameStore(drawn, LinearArray(), Imaging()).prepare([Pose()])
    monkeypatch.setenv("COLUMNS", "60")
    assert cli.main(["cache", "--files"]) == 0
    lines = capsys.readouterr().out.splitlines()[3:]
    assert max(map(len, lines)) <= 60
    assert "    Phantom(seed=5," in lines


def test_files_and_clear_do_not_go_together(capsys, folder):
    assert cli.main(["cache", "--files", "--clear"]) == 2
    assert "not allowed with argument" in capsys.readouterr().err
    assert len(list(folder.iterdir())) == 1


def test_tells_frames_of_another_simulator_apart(capsys, folder, monkeypatch):
    monkeypatch.setattr(frames, "SIMULATOR", "changed since")
    lines = shown(capsys, "--files")
    assert lines[2] == "1 of another version of the simulator, which this one does not use"
    assert lines[4].endswith(", of another version of the simulator")


def test_a_file_that_is_not_readable_is_shown_and_cleared(capsys, folder):
    (folder / "frames-0.npz").write_bytes(b"not a frame")
    lines = shown(capsys, "--files")
    assert lines[2] == "1 not readable"
    assert any(line.startswith("not readable, 0.0 MB, last used") for line in lines)
    assert shown(capsys, "--clear")[0].startswith("removed 2 files")


def test_tables_are_listed_and_cleared_too(capsys, folder, monkeypatch):
    path = table_files.TABLES.path("f" * 64)
    table_files.write(
        path, table_files.Contents("depth 0.0943021 m, Probe()", table_files.CODE, {"a": np.ones(3)})
    )
    lines = shown(capsys, "--files")
    assert lines[2].startswith("tables: 1 file, 0.0 MB")
    assert lines[5].startswith("a table, 0.0 MB, last used 2")
    assert lines[6:] == ["depth 0.0943 m, default probe"]
    monkeypatch.setattr(table_files, "CODE", "changed since")
    assert shown(capsys)[3] == "1 of another version of the simulator, which this one does not use"
    path.write_bytes(b"not a table")
    assert shown(capsys)[3] == "1 not readable"
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
