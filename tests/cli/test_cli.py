"""The command line: exit statuses, one-sentence refusals, and a trial from end to end."""

import os
import re
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import pytest
from state_files import read_state

from usbench import cli, records, suite
from usbench.agents.zoo import ZOO
from usbench.cli import list as list_command
from usbench.trials import runner

RUN = ["run", "--algo", "vpg", "--task", "pp", "--steps", "128"]


def refusal(capsys, *argv):
    """Run a command line that is to be refused; return its one line on stderr."""
    assert cli.main(list(argv)) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("usbench: error: ") and captured.err.count("\n") == 1
    return captured.err


@pytest.mark.parametrize("argv", [["list"], ["leaderboard"], [*RUN, "--quiet"]])
@pytest.mark.parametrize("text", ["x", "0", "1.5"])
def test_a_number_of_threads_that_cannot_be_is_refused_by_every_command(capsys, monkeypatch, argv, text):
    monkeypatch.setenv("USBENCH_THREADS", text)
    assert f"USBENCH_THREADS must be a whole number from 1, not {text!r}." in refusal(capsys, *argv)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (["--algo", "vgp"], "'vpg'"),
        (["--task", "focal"], "fp"),
        (["--noise", "1.5"], "1.5"),
        (["--noise", "-0.1"], "-0.1"),
        (["--noise", "nan"], "nan"),
        (["--noise", "loud"], "'loud'"),
        (["--seed", "-1"], "-1"),
        (["--seed", "0.5"], "0.5"),
        (["--steps", "0"], "0"),
        (["--steps", "-5"], "-5"),
        (["--steps", "1e2x"], "1e2x"),
        (["--n-frames", "0"], "0"),
        (["--n-frames", "1.5"], "1.5"),
        (["--set", "n_value_step=80"], "'n_value_steps'"),
        (["--set", "gamma=2.0"], "2.0"),
        (["--set", "gamma"], "name=value"),
        (["--set", "=3"], "name=value"),
        (["--set", "gamma=0.9", "gamma=0.8"], "--set takes gamma once, not 2 times"),
        (["--preset", "spin"], "'spin'"),
        (["--sed", "1"], "--sed"),
        (["--seed"], "--seed"),
    ],
)
def test_bad_arguments_are_refused_in_one_sentence(capsys, changes, said):
    assert said in refusal(capsys, *RUN, *changes)


@pytest.mark.parametrize(
    ("argv", "said"), [([], "COMMAND"), (["rum"], "'rum'"), (["run", "--task", "pp"], "--algo")]
)
def test_incomplete_command_lines_are_refused(capsys, argv, said):
    assert said in refusal(capsys, *argv)


def test_output_folder_that_cannot_be_written_is_refused(capsys, tmp_path, quick):
    (tmp_path / "file").write_text("")
    assert "choose another folder" in refusal(capsys, *RUN, "--out", str(tmp_path / "file"))
    assert "choose another folder" in refusal(capsys, *RUN, "--out", str(tmp_path / "file" / "below"))


@pytest.mark.skipif(not os.path.exists("/proc/self"), reason="a folder that takes no file is one of Linux")
@pytest.mark.parametrize(
    "argv",
    [
        [*RUN, "--out", "/proc"],
        ["frame", "--out", "/proc/frame.png"],
        ["watch", "best:pp", "--out", "/proc/film.gif"],
        ["plot", "published", "--out", "/proc/figures"],
    ],
)
def test_a_folder_that_takes_no_file_is_named_with_what_is_wrong(capsys, argv):
    assert cli.main(argv) == 2
    *_, said = capsys.readouterr().err.splitlines()
    assert re.fullmatch(
        r"usbench: error: the (output )?folder '/proc(/figures)?' cannot be written "
        r"\(No such file or directory\): choose another folder\.",
        said,
    )


@pytest.mark.parametrize("command", ["leaderboard", "compare", "transfer"])
def test_a_folder_is_no_file_of_a_leaderboard(capsys, tmp_path, command):
    for folder in (".", str(tmp_path)):
        said = f"must be a file, for example leaderboard.md, not the folder {folder!r}"
        assert said in refusal(capsys, command, "--leaderboard", folder)
    assert "must end with .md, not 'board.txt'" in refusal(capsys, command, "--leaderboard", "board.txt")


def test_trial_from_end_to_end_and_once_more(capsys, tmp_path, quick):
    argv = [*RUN, "--out", str(tmp_path)]
    assert cli.main(argv) == 0
    captured = capsys.readouterr()
    (folder,) = records.trial_folders(tmp_path)
    anchors = records.Trial.read(folder).anchors
    returns = [f"{anchors.optimal:.2f}", f"{anchors.random:.2f}"]
    for word in ("vpg, sampled", "vpg, greedy", "random", "optimal", *returns):
        assert word in captured.out
    for path in (folder, folder / "learning_curve.png", folder / "replay.gif"):
        assert f"{path}\n" in captured.out and path.exists()
    assert "step 128: evaluation return" in captured.err
    assert "simulating frames: 216 of 216" in captured.err
    # Readable in a file: a few whole lines, no bars drawn over each other.
    assert "\r" not in captured.err and captured.err.count("\n") < 20

    assert cli.main(argv) == 0
    captured = capsys.readouterr()
    assert "finished already" in captured.out and "--overwrite" in captured.out
    assert captured.err == ""


@pytest.mark.parametrize(
    ("seed", "options", "said"),
    [
        (100, ["--set", "n_steps=32"], True),
        (3, ["--set", "n_steps=32"], False),
        (100, [], False),
        (100, ["--set", "n_steps=32", "--quiet"], False),
    ],
)
def test_a_seed_kept_for_comparisons_is_told_where_hyperparameters_are_tried(
    capsys, tmp_path, quick, seed, options, said
):
    argv = ["run", "--algo", "vpg", "--task", "pp", "--steps", "32", "--out", str(tmp_path)]
    assert cli.main([*argv, "--seed", str(seed), *options]) == 0
    line = (
        "seed 100 is one of those kept for what is reported (100 to 999): seeds 0 to 9 are for trying "
        "hyperparameters"
    )
    assert (line in capsys.readouterr().err.splitlines()) == said


def test_an_agent_that_does_not_learn_has_no_learning_curve(capsys, tmp_path, quick):
    command = ["run", "--algo", "stay", "--task", "fp", "--quiet", "--out", str(tmp_path / "runs")]
    assert cli.main(command) == 0
    out = capsys.readouterr().out
    (folder,) = records.trial_folders(tmp_path / "runs")
    assert (folder / "replay.gif").exists() and f"replay:         {folder / 'replay.gif'}" in out
    assert not (folder / "learning_curve.png").exists() and "learning curve" not in out
    # Nor does `usbench plot` draw one.
    assert cli.main(["plot", str(folder), "--out", str(tmp_path / "figures")]) == 0
    assert [path.name for path in (tmp_path / "figures").iterdir()] == ["scores.png"]


def test_quiet_run_of_single_frames_tells_what_is_not_learned_from(capsys, tmp_path, quick):
    command = [*RUN[:-1], "100", "--n-frames", "1", "--quiet", "--out", str(tmp_path)]
    assert cli.main(command) == 0
    captured = capsys.readouterr()
    assert captured.err == "" and "last 36 of 100 steps" in captured.out
    (folder,) = records.trial_folders(tmp_path)
    assert read_state(folder)["config"]["n_frames"] == 1


def test_failure_while_running_is_one_sentence_and_status_1(capsys, tmp_path, quick, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(runner, "Evaluator", full)
    argv = [*RUN, "--quiet", "--out", str(tmp_path)]
    assert cli.main(argv) == 1
    error = capsys.readouterr().err
    assert error.endswith("No space left on device (--debug shows where)\n") and error.count("\n") == 1
    with pytest.raises(runner.TrialError):
        cli.main([*argv, "--debug"])


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (AssertionError(), "AssertionError"),
        (MemoryError(), "MemoryError"),
        (KeyError("gamma"), "KeyError: 'gamma'"),
        (ValueError("two\nlines"), "two lines"),
        (OSError(28, "No space left on device"), "reading or writing failed (No space left on device)."),
        (OSError(13, "Not allowed", "a"), "'a' cannot be read or written (Not allowed)."),
        (OSError("this build cannot"), "this build cannot"),
    ],
)
def test_an_error_that_says_too_little_is_told_with_its_kind(capsys, monkeypatch, error, said):
    def fail(*_):
        raise error

    monkeypatch.setattr(list_command, "_call", fail)
    assert cli.main(["list"]) == 1
    assert capsys.readouterr().err == f"usbench: error: {said}\n"


@pytest.mark.parametrize(
    ("options", "said"),
    [([], "the same command goes on"), (["--overwrite"], "the same command without --overwrite goes on")],
)
def test_interruption_is_status_130_and_keeps_the_state(capsys, tmp_path, quick, monkeypatch, options, said):
    def interrupt(*_):
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(5)

    monkeypatch.setattr(runner, "Evaluator", interrupt)
    assert cli.main([*RUN, "--quiet", "--out", str(tmp_path), *options]) == 130
    assert said in capsys.readouterr().err
    (folder,) = records.trial_folders(tmp_path)
    assert read_state(folder)["status"] == "interrupted"


def test_a_command_of_a_thread_hears_no_signals_and_runs(capsys):
    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(cli.main, ["list"]).result() == 0
    assert "algorithms" in capsys.readouterr().out


def test_list_shows_a_line_for_each_task_and_algorithm_in_80_columns(capsys):
    assert cli.main(["list"]) == 0
    shown = capsys.readouterr().out
    assert max(map(len, shown.splitlines())) <= 80 and "n_value_steps" not in shown
    tasks, _, algorithms = shown.partition("probes,")[0].partition("algorithms:")
    for name, row in ZOO.items():
        assert re.search(rf"^  {name} .*{re.escape(row.title)} *$", algorithms, re.MULTILINE)
    for name, task in suite.TASKS.items():
        line = rf"^  {name} +{task.steps} +{re.escape(task.guidance.title)} *$"
        assert re.search(line, tasks, re.MULTILINE)


@pytest.mark.parametrize(("name", "said"), [
    ("vpg", ["usbench.agents.vpg:VPG", "n_value_steps=3", "--task fp", "--preset spinup"]),
    ("oracle", ["usbench.agents.baselines:Oracle", "does not learn"]),
    ("pp", ["usbench/ProbePlane-v0", "action 3", "rotate counter-clockwise", "16064", "56"]),
])  # fmt: skip
def test_list_shows_everything_about_one(capsys, name, said):
    assert cli.main(["list", name]) == 0
    shown = capsys.readouterr().out
    assert all(words in shown for words in said)


def test_list_says_what_a_trained_agent_is(capsys):
    assert "a trained agent that comes with the package" in refusal(capsys, "list", "best:pp")


def test_list_says_which_command_shows_a_probe(capsys):
    assert "but a probe: usbench defaults l7-4 shows its fields." in refusal(capsys, "list", "l7-4")


def test_list_refuses_an_unknown_name_with_the_closest(capsys):
    assert "did you mean 'qrdqn'?" in refusal(capsys, "list", "qdqn")


@pytest.mark.parametrize(("typed", "meant"), [("wach", "watch"), ("leaderbord", "leaderboard")])
def test_an_unknown_command_is_told_the_closest(capsys, typed, meant):
    assert f"invalid choice: {typed!r}" in (told := refusal(capsys, typed))
    assert f"(did you mean {meant!r}?)" in told


@pytest.mark.parametrize("command, argument", [("watch", "TRIAL"), ("guide", "TRIAL"), ("list", "NAME")])
def test_a_second_argument_is_refused_with_what_the_command_takes(capsys, command, argument):
    said = refusal(capsys, command, "runs/one", "runs/two")
    assert f"runs/two: usbench {command} takes one argument ({argument})" in said


@pytest.mark.parametrize(
    ("argv", "takes"),
    [
        (["cache", "foo"], "options alone (--debug, --files, --clear)"),
        (["defaults", "probe", "foo"], "one argument (KIND)"),
        (["plot", "mine", "--format", "png", "--out", "here", "foo"], "all of its arguments (RUNS) before"),
    ],
)
def test_an_argument_that_nothing_takes_is_refused_with_what_is_allowed(capsys, argv, takes):
    assert f"unrecognized arguments: foo: usbench {argv[0]} takes {takes}" in refusal(capsys, *argv)


def test_help_shows_examples_and_does_not_wait_for_torch():
    code = "import sys; from usbench.cli import main; sys.exit(main(['--help']) or 'torch' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0
    assert "usbench run --algo vpg --task pp" in done.stdout


FIRST_LINE = """
import sys
from usbench.cli import main
class Terminal:
    line = "nothing"
    def isatty(self): return True
    def flush(self): pass
    def write(self, text):
        if self.line == "nothing":
            self.line = f"{'pandas' in sys.modules}: {text}"
sys.stderr = Terminal()
main(sys.argv[1:])
print(sys.stderr.line)
"""


@pytest.mark.parametrize(
    ("command", "line"),
    [
        (["watch", "nowhere"], "opening the trial"),
        (["report", "nowhere"], "reading the records, then drawing: some seconds for each agent"),
        (["frame", "--task", "focal"], "simulating the frame, then drawing it: some seconds"),
        (["compare", "--algos", "vgp"], "looking at the trials"),
        (["search", "--algo", "vgp"], "looking at the records"),
        (["transfer", "--leaderboard", "nowhere.md"], "loading PyTorch: some seconds; then"),
        (["dataset", "--task", "focal", "--agent", "best"], "loading PyTorch: some seconds"),
    ],
)
def test_commands_say_what_they_do_before_they_load_what_takes_seconds(tmp_path, command, line):
    run = [sys.executable, "-c", FIRST_LINE, *command]
    done = subprocess.run(run, capture_output=True, text=True, cwd=tmp_path)
    assert done.stdout.startswith(f"False: {line}"), done


@pytest.mark.parametrize("name", sorted(cli.build_parser()[1]))
def test_helps_fit_80_columns(name, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    text = cli.build_parser()[1][name].format_help()
    assert [line for line in text.split("\n") if len(line) > 80] == []
    # No name is broken at a hyphen: "pp-random" can be copied.
    assert [line for line in text.split("\n") if re.search(r"\w-$", line)] == []


@pytest.mark.parametrize(
    ("option", "value", "said"),
    [
        ("--task", "pq", "unknown task 'pq' (did you mean 'pp'?)"),
        ("--seed", "x", "seed must be a whole number"),
        ("--study", "bad/name", "the name of a study must be of up to 64 letters"),
        ("--study=anna", "--seed=3", "--seed has no part in a study"),
    ],
)
def test_what_a_guide_cannot_use_is_refused_before_its_address_is_told(capsys, option, value, said):
    assert said in refusal(capsys, "guide", option, value)


def test_a_guide_with_a_damaged_trial_is_refused(capsys, tmp_path):
    (tmp_path / "trial.json").write_text("{")
    assert "is not a trial record" in refusal(capsys, "guide", str(tmp_path))


@pytest.mark.parametrize("command", ["plot", "report"])
def test_runs_beside_what_is_in_its_place_are_refused(capsys, command):
    assert "RUNS is in place of --runs" in refusal(capsys, command, "mine", "--runs", "yours")


def test_module_is_the_command():
    done = subprocess.run([sys.executable, "-m", "usbench", "--version"], capture_output=True, text=True)
    assert done.returncode == 0 and done.stdout.startswith("usbench 0.")


@pytest.fixture
def nobody():
    """The end of a pipe whose reader has gone, as `head -1` does once it has its line."""
    reader, writer = os.pipe()
    os.close(reader)
    yield writer
    os.close(writer)


# Rich ends a command by itself; of a help, argparse drops what cannot be written.
@pytest.mark.parametrize(
    ("argv", "status"), [(["list"], 141), (["defaults", "probe"], 141), (["list", "--help"], 0)]
)
@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_closed_pipe_ends_a_command_without_a_word(nobody, argv, status, unbuffered):
    run, env = [sys.executable, "-m", "usbench", *argv], os.environ | {"PYTHONUNBUFFERED": unbuffered}
    done = subprocess.run(run, stdout=nobody, stderr=subprocess.PIPE, text=True, env=env)
    assert (done.returncode, done.stderr) == (status, "")


def test_an_error_that_nobody_reads_is_the_end_of_a_command(nobody):
    run = [sys.executable, "-m", "usbench", "list", "nothing"]
    assert subprocess.run(run, stdout=nobody, stderr=nobody).returncode == 141


def test_a_closed_output_is_one_that_nobody_wants():
    run = f'"{sys.executable}" -m usbench list >&-'
    done = subprocess.run(run, shell=True, stderr=subprocess.PIPE, text=True)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="a disk that is always full is one of Linux")
def test_output_for_a_full_disk_is_one_sentence():
    run, env = [sys.executable, "-m", "usbench", "list", "pp"], os.environ | {"PYTHONUNBUFFERED": ""}
    with open("/dev/full", "w") as full:
        done = subprocess.run(run, stdout=full, stderr=subprocess.PIPE, text=True, env=env)
    assert done.returncode == 1
    assert done.stderr.startswith("usbench: error: ") and done.stderr.count("\n") == 1


@pytest.mark.parametrize(("algo", "says"), [("ppo_asymmetric", True), ("double_dqn", True), ("ppo", False)])
def test_list_says_which_agents_are_no_row_of_the_comparison(capsys, algo, says):
    assert cli.main(["list", algo]) == 0
    assert ("made for unseen phantoms" in " ".join(capsys.readouterr().out.split())) == says
