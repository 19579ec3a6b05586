"""The guide's routes and its command, without a browser."""

import contextlib
import gc
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.parse
import urllib.request
from pathlib import Path
from urllib.request import url2pathname

import pytest

from usbench import cli
from usbench.envs import guidance
from usbench.envs.bmode import Imaging
from usbench.guide import access, desk, examination
from usbench.guide import server as guide_server
from usbench.guide.session import Session
from usbench.records import ConfigurationError
from usbench.setting import Setting
from usbench.trials import runner
from usbench.trials.configuration import resolve

TOKEN = "0123456789abcdef"
# The command on drawn frames, as a user starts it.
COMMAND = """
import sys
sys.path.insert(0, {folder!r})
import sweep_worker
sweep_worker.quick()
from usbench import cli
from usbench.envs import guidance
from usbench.envs.bmode import Imaging
from usbench.guide import examination
examination.frame_store = guidance.frame_store
sys.exit(cli.main(["guide", "--runs", {runs!r}, "--no-browser"]))
"""


@pytest.fixture
def url(quick, monkeypatch, tmp_path):
    """A guide that is served without trials."""
    monkeypatch.setattr(examination, "frame_store", guidance.frame_store)
    with serving(lambda tell: Session(tmp_path, seed=0, tell=tell)) as url:
        settled(url)
        yield url


@contextlib.contextmanager
def serving(make):
    """Serve the session that `make` makes; what comes out is the address without the token."""
    with guide_server.listening() as listener:
        work = desk.Desk()
        server = guide_server.server(work, TOKEN)
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]})
        thread.start()
        work.start(make, failed=lambda: setattr(server, "should_exit", True))
        try:
            yield guide_server.address(listener, TOKEN).partition("?")[0]
        finally:  # else a test that fails never ends
            server.should_exit = True
            work.close()
            thread.join()


def ask(url, body=None, token=TOKEN, **headers):
    """Return status and answer; a body is bytes, or a value that is sent as JSON."""
    sent = {"content-type": "application/json", "authorization": f"token {token}"}
    sent |= {name.replace("_", "-"): value for name, value in headers.items()}
    data = body if body is None or isinstance(body, bytes) else json.dumps(body).encode()
    request = urllib.request.Request(url, data, sent)
    try:
        with urllib.request.urlopen(request, timeout=60) as response:
            return response.status, response.read().decode()
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.read().decode()


def settled(url, token=TOKEN):
    """Return the state once the guide is no longer busy."""
    deadline = time.monotonic() + 60
    while (state := json.loads(ask(url + "state", token=token)[1]))["busy"] and time.monotonic() < deadline:
        time.sleep(0.01)
    return state


def press(url, button, body=None, **headers):
    """Press a button on a page that is up to date; return status and answer."""
    status, answer = ask(url + button, {**(body or {}), "place": settled(url)["place"]}, **headers)
    return (status, json.dumps(settled(url))) if json.loads(answer).get("busy") else (status, answer)


def test_buttons_answer_with_the_new_state(url):
    before, after = (settled(url), json.loads(press(url, "act", {"action": 4})[1]))
    assert after["step"] == 1
    assert after["pose"]["angle_deg"] == before["pose"]["angle_deg"] + 15
    assert json.loads(press(url, "follow")[1])["step"] == 2
    assert json.loads(press(url, "choose", {"task": "fp"})[1])["task"] == "fp"
    assert json.loads(press(url, "begin")[1])["step"] == 0


@pytest.mark.parametrize(
    ("elsewhere", "chosen"), [("act", {"action": 3}), ("begin", {}), ("choose", {"noise": 0.5})]
)
def test_page_that_is_out_of_date_does_nothing_and_learns_what_is(url, elsewhere, chosen):
    place = settled(url)["place"]
    now = json.loads(press(url, elsewhere, chosen)[1])
    for button, body in (("act", {"action": 4}), ("follow", {}), ("begin", {}), ("choose", {"task": "fp"})):
        status, answer = ask(url + button, {**body, "place": place})
        answer = json.loads(answer)
        assert status == 409 and answer["error"].startswith("This examination went on in another tab")
        # The page says so too, where it finds out by itself.
        assert answer["error"] == answer["state"]["elsewhere"]
        assert answer["state"] == now == settled(url), button
    assert ask(url + "act", {"action": 4})[0] == ask(url + "act", {"action": 4, "place": [1]})[0] == 409


def test_questions_change_nothing(url):
    settled(url)
    first = ask(url + "state")
    assert ask(url + "state") == first == ask(url + "update", {})


@pytest.mark.parametrize(
    ("route", "body", "sentence"),
    [
        ("act", {"action": 7}, "action must be a whole number in [0, 4], not 7."),
        ("act", {"action": 1e999}, "action must be a whole number"),
        ("act", {"steps": 7}, "an object with the keys ['action'], not ['steps']"),
        ("act", {}, "an object with the keys ['action'], not []"),
        ("act", [], "must be a JSON object."),
        ("act", b'{"action": 4', "must be a JSON object."),
        ("act", b"\xff", "must be a JSON object."),
        ("act", b"[" * 4000, "must be a JSON object."),
        ("act", b'{"action": ' + b"[" * 4000, "must be a JSON object."),
        ("choose", {"hidden": "yes"}, "hidden must be true or false, not 'yes'."),
        ("choose", {"task": [["pp"]]}, "unknown task [['pp']]"),
        ("choose", {"noise": float("nan")}, "noise must be a probability"),
        ("choose", {"agent": "/etc/passwd"}, "unknown agent '/etc/passwd'"),
        ("choose", {"noise": 2}, "noise must be a probability"),
    ],
)
def test_what_no_button_sends_is_refused_in_words(url, route, body, sentence):
    status, answer = press(url, route, body) if isinstance(body, dict) else ask(url + route, body)
    assert status == 400 and sentence in json.loads(answer)["error"]


def test_without_the_token_nothing_is_told_and_nothing_done(url):
    for token in ("", "0" * 48, TOKEN + "0", "é"):
        for route, body in (("state", None), ("act", {"action": 4}), ("choose", {"hidden": False})):
            status, answer = ask(url + route, body, token)
            assert status == 401 and json.loads(answer).keys() == {"error"}, (route, token)
            assert "open the address that the guide printed" in answer
    for route in ("update", "follow", "begin", "train"):
        assert ask(url + route, {}, "0" * 48)[0] == 401, route
    assert ask(url + "act", {"action": 4}, authorization=f"Basic {TOKEN}")[0] == 401
    assert settled(url)["step"] == 0


def test_other_sites_cannot_press_buttons(url):
    own = url.removesuffix("/")
    for origin in ("http://example.org", "null", own.replace("http:", "https:"), own.rpartition(":")[0]):
        assert ask(url + "act", {"action": 4}, origin=origin)[0] == 403, origin
        assert ask(url + "state", origin=origin)[0] == 403, origin
        assert ask(url + "update", {}, origin=origin)[0] == 403, origin
    assert ask(url + "act", {"action": 4}, content_type="text/plain")[0] == 415
    assert ask(url + "state", host="example.org")[0] == 400
    assert settled(url)["step"] == 0
    assert press(url, "act", {"action": 4}, origin=own)[0] == 200
    # Behind `ssh -L 8000:...` the browser asks another port than the server's.
    there = {"host": "localhost:8000", "origin": "http://localhost:8000"}
    assert press(url, "act", {"action": 4}, **there)[0] == 200


def test_long_bodies_are_refused(url):
    place = settled(url)["place"]
    assert ask(url + "act", json.dumps({"action": 4, "place": place}).encode().ljust(4096))[0] == 200
    for length in (4097, 1_000_000):
        status, answer = ask(url + "act", b'{"action": 4}'.ljust(length))
        assert (status, json.loads(answer)["error"]) == (413, "the body must have at most 4096 bytes.")
    assert settled(url)["step"] == 1


def test_a_sender_that_goes_away_is_refused_without_a_traceback(url, caplog):
    address = urllib.parse.urlsplit(url)
    head = (
        f"POST /act HTTP/1.1\r\nHost: {address.netloc}\r\nAuthorization: token {TOKEN}\r\n"
        "Content-Type: application/json\r\nContent-Length: 100\r\n\r\n{"
    )
    with socket.create_connection((address.hostname, address.port)) as sender:
        sender.sendall(head.encode())
    assert settled(url)["step"] == 0  # asked afterwards
    time.sleep(0.2)
    assert "Traceback" not in caplog.text


def test_tokens_are_long_and_differ():
    tokens = {access.new_token() for _ in range(100)}
    assert len(tokens) == 100 and {len(token) for token in tokens} == {48}


def test_browser_is_led_by_a_file_since_all_users_can_read_command_lines(tmp_path, monkeypatch):
    def read(address):
        path = Path(url2pathname(address[7:]))
        seen.append((address, path, path.read_text(), path.parent.stat().st_mode & 0o777))

    def refuse(_):
        raise ConfigurationError("no session.")

    seen = []
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr("webbrowser.open", read)
    with guide_server.listening() as listener, pytest.raises(ConfigurationError, match="no session"):
        guide_server.serve(refuse, listener, browser=True)
    ((address, path, text, mode),) = seen
    assert address.startswith("file://") and "token" not in address
    assert "/?token=" in text and (os.name == "nt" or mode == 0o700) and not path.exists()


def test_work_that_takes_long_runs_beside_the_server(quick, monkeypatch, tmp_path):
    """The server says at once what is being done, refuses other work meanwhile, and shows the result."""
    monkeypatch.setattr(examination, "frame_store", guidance.frame_store)
    gate = threading.Event()

    def make(tell):
        tell("loading")
        gate.wait(60)
        return Session(tmp_path, seed=0, tell=tell)

    with serving(make) as url:
        assert json.loads(ask(url + "state")[1]) == {"busy": "loading"}
        assert ask(url)[0] == 200
        status, answer = ask(url + "act", {"action": 4, "place": None})
        assert (status, json.loads(answer)["error"]) == (409, "The guide is busy: loading.")
        gate.set()
        settled(url)
        gate.clear()
        policy = Setting.plan
        monkeypatch.setattr(Setting, "plan", lambda self, target: gate.wait(60) and policy(self, target))
        asked = {"task": "exam", "noise": 0.5, "place": settled(url)["place"]}
        began = time.monotonic()
        answer = json.loads(ask(url + "choose", asked)[1])
        assert (answer["busy"], answer["task"]) == ("computing the optimum of exam, noise 0.5", "pp")
        assert 0.3 <= time.monotonic() - began < 5
        status, refused = ask(url + "act", {"action": 4, "place": answer["place"]})
        refused = json.loads(refused)
        assert status == 409 and refused["error"].startswith(
            "The guide is busy: computing the optimum of exam"
        )
        assert json.loads(ask(url + "update", {})[1])["busy"] == refused["state"]["busy"] == answer["busy"]
        gate.set()
        after = settled(url)
        assert (after["task"], after["noise"], after["step"], after["busy"]) == ("exam", 0.5, 0, "")


def test_work_that_fails_late_says_why(quick, monkeypatch, tmp_path, caplog):
    monkeypatch.setattr(examination, "frame_store", guidance.frame_store)

    def refuse(self, action):
        time.sleep(0.5)
        raise ValueError("this cannot be.")

    monkeypatch.setattr(Session, "act", refuse)
    with serving(lambda tell: Session(tmp_path, seed=0, tell=tell)) as url:
        assert json.loads(press(url, "act", {"action": 1})[1])["message"] == "this cannot be."
        assert json.loads(press(url, "begin")[1])["message"] == ""
    gc.collect()
    assert "never retrieved" not in caplog.text


def test_a_disk_that_is_full_is_told_and_the_guide_goes_on(quick, monkeypatch, tmp_path):
    monkeypatch.setattr(examination, "frame_store", guidance.frame_store)

    def refuse(self, action):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Session, "act", refuse)
    with serving(lambda tell: Session(tmp_path, seed=0, tell=tell)) as url:
        status, answer = press(url, "act", {"action": 1})
        assert (status, json.loads(answer)["error"]) == (500, "OSError: [Errno 28] No space left on device")
        assert press(url, "begin")[0] == 200


def test_a_state_that_cannot_be_shown_leaves_no_page_busy(quick, monkeypatch, tmp_path):
    monkeypatch.setattr(examination, "frame_store", guidance.frame_store)
    with serving(lambda tell: Session(tmp_path, seed=0, tell=tell)) as url:
        settled(url)
        with monkeypatch.context() as broken:
            broken.setattr(Session, "state", lambda self: {}["gone"])
            assert press(url, "begin")[0] == 500
        status, answer = ask(url + "update", {})
        assert (status, json.loads(answer)["busy"]) == (200, "")


def test_frames_of_the_next_actions_are_simulated_while_nobody_asks(quick, monkeypatch, tmp_path):
    shown = []

    class Noting(guidance.frame_store(None, None, Imaging()).__class__):
        def prepare(self, poses, progress=None):
            shown.extend(poses)

    monkeypatch.setattr(examination, "frame_store", lambda *_: Noting())
    session = Session(tmp_path, seed=0)
    while session.prepare():
        pass
    pose, task = session.examination.pose, session.setting.guidance
    assert shown[0] == pose and shown[1] == pose.moved(task.actions[session.examination.advice.best].move)
    assert {*shown} == {pose.moved(action.move, task.limits) for action in task.actions}
    session.follow()
    assert session.prepare()


@pytest.mark.parametrize(("seconds", "gets_ready"), [(60, False), (0.001, True)])
def test_nothing_is_got_ready_before_an_answer_is_sent(seconds, gets_ready, quick, monkeypatch, tmp_path):
    """What is asked for meanwhile is done at once, however long that is."""
    monkeypatch.setattr(examination, "frame_store", guidance.frame_store)
    monkeypatch.setattr(desk, "ANSWERING", seconds)
    begun = threading.Event()
    monkeypatch.setattr(Session, "prepare", lambda session: begun.set())
    work = desk.Desk()
    work.start(lambda tell: Session(tmp_path, seed=0, tell=tell))
    for _ in range(2):
        work.do(Session.follow).result(timeout=30)
    assert work.state()["step"] == 2
    assert begun.wait(60 if gets_ready else 0) == gets_ready
    work.close()


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
        (["nowhere"], "'nowhere' is not the folder of a trial: it does not exist."),
        (["negative.toml"], "'negative.toml' is not the folder of a trial: it is a file."),
        (["bst:pp"], "no trained agent 'bst:pp' comes with the package"),
        (["--port", "http"], "port must be a whole number in [0, 65535], not 'http'."),
        (["--task", "xp"], "unknown task 'xp'"),
        (
            ["--task", "setup"],
            "the guide shows only tasks that move the probe, not 'setup': allowed are 'fp'",
        ),
        (["--noise", "2"], "noise must be a probability in [0, 1], not 2."),
        (["--seed", "x"], "seed"),
        (["--runs", "nowhere"], "there is no folder 'nowhere' with trials."),
        (["--runs", "negative.toml"], "'negative.toml' is a file, not a folder with trials."),
        (["--runs", "negative.toml", "--study", "anna"], "'negative.toml' is a file, not a folder"),
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


@pytest.mark.parametrize(
    "arguments",
    [
        ["nowhere"],
        ["best:setup"],
        ["best:pq"],
        ["--task", "xp"],
        ["--task", "setup"],
        ["best:fp", "--task", "pp"],
        ["best:fp", "--task", "setup"],
        ["--noise", "2"],
    ],
)
def test_what_is_wrong_is_refused_before_an_address_is_told(arguments, capsys):
    assert cli.main(["guide", "--no-browser", *arguments]) == 2
    assert "http" not in "".join(capsys.readouterr())


def test_an_agent_that_does_not_learn_is_refused_before_an_address_is_told(quick, tmp_path, capsys):
    folder = runner.run_trial(resolve("random", "pp"), tmp_path).folder
    assert cli.main(["guide", "--no-browser", str(folder)]) == 2
    out, err = capsys.readouterr()
    assert out == "" and err == f"usbench: error: {str(folder)!r} is not the trial of an agent that learns.\n"


def test_without_the_extra_the_command_says_what_to_install(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "starlette.applications", None)
    monkeypatch.delitem(sys.modules, "usbench.guide.server")
    monkeypatch.delattr("usbench.guide.server")
    assert cli.main(["guide"]) == 2
    assert "pip install 'usbench[guide]'" in capsys.readouterr().err


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
@pytest.mark.parametrize("when", ["at once", "when it is ready"])
def test_ctrl_c_ends_the_command_within_a_second_and_without_a_traceback(tmp_path, when):
    code = COMMAND.format(folder=str(Path(__file__).parents[1] / "support"), runs=str(tmp_path))
    command = [sys.executable, "-c", code]
    with (
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process,
        contextlib.ExitStack() as at_end,
    ):
        at_end.callback(process.kill)  # also where something fails
        url, _, token = process.stdout.readline().split()[4].partition("?token=")
        if when == "at once":
            assert json.loads(ask(url + "state", token=token)[1])["busy"]
        else:
            assert settled(url, token)["step"] == 0
            assert ask(url + "state", token="")[0] == 401
        began = time.monotonic()
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=60)
    took = time.monotonic() - began
    assert process.returncode == 130
    assert errors.splitlines()[-1] == (
        "usbench: interrupted, the guide has ended; a study or a training that was begun goes on "
        "when it is started again."
    )
    assert "Traceback" not in errors
    # Where more wants to run than there are cores, everything takes as much longer.
    assert took < max(1, os.getloadavg()[0] / os.cpu_count())
