"""The guide's routes and its command, without a browser."""

import json
import os
import signal
import subprocess
import sys
import threading
import urllib.error
import urllib.request
from pathlib import Path

import pytest

from usbench import cli
from usbench.envs import guidance
from usbench.guide import examination
from usbench.guide import server as guide_server
from usbench.guide.session import Session
from usbench.records import ConfigurationError

# The command on drawn frames, as a user starts it.
COMMAND = """
import sys
sys.path.insert(0, {folder!r})
import sweep_worker
sweep_worker.quick()
from usbench import cli
from usbench.envs import guidance
from usbench.guide import examination
examination.frame_store = guidance.frame_store
sys.exit(cli.main(["guide", "--runs", {runs!r}, "--no-browser"]))
"""


@pytest.fixture
def url(quick, monkeypatch, tmp_path):
    """A guide that is served without trials."""
    monkeypatch.setattr(examination, "frame_store", guidance.frame_store)
    with guide_server.listening() as listener:
        server = guide_server.server(Session(tmp_path, seed=0))
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]})
        thread.start()
        yield guide_server.address(listener)
        server.should_exit = True
        thread.join()


def ask(url, body=None, **headers):
    """Return status and answer."""
    sent = {"content-type": "application/json"} | {name.replace("_", "-"): v for name, v in headers.items()}
    request = urllib.request.Request(url, None if body is None else json.dumps(body).encode(), sent)
    try:
        with urllib.request.urlopen(request, timeout=60) as response:
            return response.status, response.read().decode()
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.read().decode()


def test_buttons_answer_with_the_new_state(url):
    before, after = (json.loads(ask(url + "state")[1]), json.loads(ask(url + "act", {"action": 4})[1]))
    assert after["step"] == 1
    assert after["pose"]["angle_deg"] == before["pose"]["angle_deg"] + 15
    assert json.loads(ask(url + "follow", {})[1])["step"] == 2
    assert json.loads(ask(url + "choose", {"task": "fp"})[1])["task"] == "fp"
    assert json.loads(ask(url + "begin", {})[1])["step"] == 0


def test_questions_change_nothing(url):
    first = ask(url + "state")
    assert ask(url + "state") == first == ask(url + "update", {})


@pytest.mark.parametrize(
    ("route", "body", "sentence"),
    [
        ("act", {"action": 7}, "action must be a whole number in [0, 4], not 7."),
        ("act", {"steps": 7}, "no other keys than ['action']"),
        ("act", {}, "action"),
        ("act", [], "must be an object"),
        ("choose", {"agent": "/etc/passwd"}, "unknown agent '/etc/passwd'"),
        ("choose", {"noise": 2}, "noise must be a probability"),
    ],
)
def test_what_no_button_sends_is_refused_in_words(url, route, body, sentence):
    status, answer = ask(url + route, body)
    assert status == 400 and sentence in json.loads(answer)["error"]


def test_other_sites_cannot_press_buttons(url):
    assert ask(url + "act", {"action": 4}, content_type="text/plain")[0] == 415
    assert ask(url + "state", host="example.org")[0] == 400
    assert json.loads(ask(url + "state")[1])["step"] == 0


def test_page_comes_from_here_alone_and_nothing_else_does(url):
    with urllib.request.urlopen(url) as response:
        assert response.headers["content-security-policy"].startswith("default-src 'self'")
        page = response.read().decode()
    assert "<title>usbench guide</title>" in page
    for name in ("guide.css", "guide.js", "scene.js", "icon.svg"):
        status, text = ask(url + name)
        # The namespace of SVG is a name, not an address.
        assert status == 200 and "http" not in text.replace("http://www.w3.org/2000/svg", "")
    assert ask(url + "../guide.py")[0] == ask(url + "%2e%2e/guide.py")[0] == 404


def test_guide_listens_on_loopback_alone():
    with guide_server.listening() as listener:
        host, port = listener.getsockname()
        assert host == "127.0.0.1" and port > 0
        with (
            pytest.raises(ConfigurationError, match=f"port {port} cannot be used"),
            guide_server.listening(port),
        ):
            pass


@pytest.mark.parametrize("port", [-1, 65536, 0.5, "http"])
def test_port_that_is_none_is_refused(port):
    with pytest.raises(ConfigurationError, match="port must be a whole"), guide_server.listening(port):
        pass


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["nowhere"], "'nowhere' is not the folder of a trial"),
        (["--port", "http"], "port must be a whole number in [0, 65535], not 'http'."),
        (["--task", "xp"], "unknown task 'xp'"),
        (
            ["--task", "setup"],
            "the guide shows tasks that move the probe alone, not 'setup': allowed are 'fp'",
        ),
        (["--noise", "2"], "noise must be a probability in [0, 1], not 2."),
        (["--seed", "x"], "seed"),
        (["--probe", "negative.toml"], "'negative.toml' cannot be used: line_spacing must be a positive"),
        (["--imaging", "negative.toml"], "'negative.toml' cannot be used: unknown field"),
    ],
)
def test_command_refuses_in_one_sentence(arguments, sentence, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("negative.toml").write_text("line_spacing = -1\n")
    assert cli.main(["guide", "--no-browser", *arguments]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("usbench: error: ") and sentence in line


def test_without_the_extra_the_command_says_what_to_install(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "starlette.applications", None)
    monkeypatch.delitem(sys.modules, "usbench.guide.server")
    monkeypatch.delattr("usbench.guide.server")
    assert cli.main(["guide"]) == 2
    assert "pip install 'usbench[guide]'" in capsys.readouterr().err


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
def test_ctrl_c_ends_the_command_without_a_traceback(tmp_path):
    code = COMMAND.format(folder=str(Path(__file__).parents[1] / "support"), runs=str(tmp_path))
    with subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        url = process.stdout.readline().split()[4]
        assert ask(url + "state")[0] == 200
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert errors.splitlines()[-1] == "usbench: interrupted, what was recorded is kept."
    assert "Traceback" not in errors
