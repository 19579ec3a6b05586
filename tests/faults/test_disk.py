"""Disks that are full or cannot be written: one sentence, nothing lost, and with room again the same bits."""

import os
import subprocess

import children
import pytest
import trials

from usbench import records

pytestmark = pytest.mark.faults

CONFIG = trials.config("vpg")


@pytest.fixture(scope="module")
def bits(tmp_path_factory):
    out = tmp_path_factory.mktemp("undisturbed")
    assert children.finish(children.trial, CONFIG, out) == 0
    return trials.bits(out / CONFIG.folder_name)


@pytest.fixture
def disk(tmp_path):
    """A small disk of its own, where mounting one is allowed."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=16m", "tmpfs", str(folder)]
    if subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("mounting a small disk needs to be root")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


def run(out, tmp_path):
    """Run the trial; return how it ended, in its own words."""
    children.finish(children.told, CONFIG, out, tmp_path / "told")
    return (tmp_path / "told").read_text()


@pytest.mark.parametrize("free_kb", [0, 8, 16, 64, 256, 512, 700, 1000, 1500])
def test_full_disk_is_said_and_with_room_the_trial_goes_on(bits, disk, tmp_path, free_kb):
    blocks = os.statvfs(disk)
    filler = disk / "filler"
    filler.write_bytes(bytes(blocks.f_bavail * blocks.f_frsize - free_kb * 1024))
    ended = run(disk, tmp_path)
    assert ended == "finished" or ("No space left" in ended and "\n" not in ended)
    assert free_kb > 100 or ended != "finished"
    filler.unlink()
    if ended != "finished":
        assert run(disk, tmp_path) == "finished"
    assert trials.bits(disk / CONFIG.folder_name) == bits


def test_disk_that_becomes_full_while_a_trial_runs(bits, disk, tmp_path):
    process = children.start(children.told, CONFIG, disk, tmp_path / "told")
    while not children.is_begun(disk / CONFIG.folder_name) and process.is_alive():
        pass
    blocks = os.statvfs(disk)
    (disk / "filler").write_bytes(bytes(blocks.f_bavail * blocks.f_frsize))
    process.join()
    assert "No space left" in (tmp_path / "told").read_text()
    (disk / "filler").unlink()
    assert records.trial_folders(disk) == [disk / CONFIG.folder_name]
    assert run(disk, tmp_path) == "finished"
    assert trials.bits(disk / CONFIG.folder_name) == bits


def test_disk_that_cannot_be_written_is_refused_and_what_is_finished_there_is_read(bits, disk, tmp_path):
    subprocess.run(["mount", "-o", "remount,ro", str(disk)], check=True)
    assert "cannot be written (Read-only file system): choose another folder." in run(disk, tmp_path)
    subprocess.run(["mount", "-o", "remount,rw", str(disk)], check=True)
    assert run(disk, tmp_path) == "finished"
    subprocess.run(["mount", "-o", "remount,ro", str(disk)], check=True)
    assert run(disk, tmp_path) == "finished"
    assert trials.bits(disk / CONFIG.folder_name) == bits


def test_folder_that_cannot_be_written_is_refused(tmp_path):
    if os.geteuid() == 0:
        pytest.skip("root may write anywhere")
    (tmp_path / "runs").mkdir(mode=0o500)
    assert "cannot be written (Permission denied)" in run(tmp_path / "runs", tmp_path)
