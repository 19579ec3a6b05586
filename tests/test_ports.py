"""Nothing listens where it was not asked to; the guide and clusters, which are, have tests of their own."""

import socket

import pytest

from usbench import cli


def test_trial_opens_no_port(quick, tmp_path, monkeypatch):
    def opened(*_):
        pytest.fail("a port was opened")

    monkeypatch.setattr(socket.socket, "bind", opened)
    monkeypatch.setattr(socket.socket, "listen", opened)
    argv = ["run", "--algo", "a2c", "--task", "pp", "--steps", "32", "--quiet", "--out", str(tmp_path)]
    assert cli.main(argv) == 0
    assert list(tmp_path.glob("*/model.zip"))
    with socket.socket() as asked_for, pytest.raises(pytest.fail.Exception):
        asked_for.bind(("127.0.0.1", 0))
