"""Warnings in a terminal: sentences for users, with no line of the source, and those of others as usual."""

import warnings

import pytest
from stored import coded_scan, fresh_stores

from usbench import cli
from usbench.cli import list as list_command
from usbench.envs import scanner
from usbench.setting import Setting

# Warnings are errors elsewhere.
pytestmark = pytest.mark.filterwarnings("default")


def shown(monkeypatch, capfd, *argv):
    """What a command shows that makes frames and does something that Python will forbid."""

    def call(_):
        Setting(task="pp").prepare_frames()
        for _ in range(2):
            warnings.warn("no room", stacklevel=1)
            warnings.warn("no room", stacklevel=1)  # another line of the source
        warnings.warn("outdated", DeprecationWarning, stacklevel=1)

    monkeypatch.setattr(scanner, "scan", coded_scan)
    fresh_stores(monkeypatch)
    monkeypatch.setattr(list_command, "_call", call)
    usual = warnings.formatwarning
    # pytest catches what would be shown.
    monkeypatch.setattr(
        warnings, "showwarning", lambda *told: print(warnings.formatwarning(*told[:4]), end="")
    )
    assert cli.main(["list", *argv]) == 0
    assert warnings.formatwarning is usual
    return capfd.readouterr().out


@pytest.fixture
def in_the_way(monkeypatch, tmp_path):
    (tmp_path / "file").write_text("in the way")  # permissions would not stop root
    place = tmp_path / "file" / "cache"
    monkeypatch.setenv("USBENCH_CACHE", str(place))
    return place


def test_frames_that_cannot_be_kept_are_told_in_one_sentence(in_the_way, monkeypatch, capfd):
    first, second, *others = shown(monkeypatch, capfd).splitlines()
    assert first == (
        f"usbench: frames are not kept on disk, as {str(in_the_way)!r} takes none (Not a directory): "
        "USBENCH_CACHE sets another folder."
    )
    assert second == "usbench: no room"  # once, though several lines warn of it
    assert "test_plain_warnings.py" in others[0] and "DeprecationWarning: outdated" in others[0]


def test_debug_shows_where_a_warning_comes_from(in_the_way, monkeypatch, capfd):
    first = shown(monkeypatch, capfd, "--debug").splitlines()[0]
    assert ".py:" in first and "UserWarning: frames are not kept on disk" in first
