"""`usbench compare` and `usbench search`: what is planned, written, refused, and the exit statuses."""

import shutil
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pandas as pd
import protocols
import pytest
from state_files import read_state, write_state
from trials import SMALL

from usbench import cli, records
from usbench.ceilings import ceiling
from usbench.compare import plan, protocol, sweep
from usbench.envs.bmode import Imaging
from usbench.envs.probe import LinearArray
from usbench.results import collecting, held_out, scores, sources, studies, tables
from usbench.trials import runner
from usbench.trials.configuration import resolve

GRID = [
    "--algos",
    "a2c",
    "--tasks",
    "pp",
    "--noise",
    "0.5",
    "--seeds",
    "2",
    "--steps",
    "64",
    "--jobs",
    "1",
]
# Two noise levels of three agents that do not learn: quick.
FLOOR = ["--algos", "random", "--tasks", "pp", "--noise", "0", "0.5", "--seeds", "1", "--jobs", "1"]


@pytest.fixture
def here(quick, monkeypatch, tmp_path):
    """Trials in this process, on drawn frames, in a folder of the test."""
    monkeypatch.setitem(sweep.run.__kwdefaults__, "executor", lambda: ThreadPoolExecutor(1))
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def no_figures(monkeypatch):
    """Figures take most of the time of a short comparison."""
    monkeypatch.setattr("usbench.figures.comparison.write", lambda *_: [])


def contents(folder):
    return {path: path.read_bytes() for path in sorted(Path(folder).rglob("*")) if path.is_file()}


def test_plan_is_the_whole_grid_with_the_reference_policies_once():
    planned = plan.plan(["vpg", "dqn", "random"], ["fp", "pp"], [0, 0.25], range(3), 64)
    algos = [config.algo for config in planned]
    assert algos.count("vpg") == algos.count("dqn") == 2 * 2 * 3
    assert algos.count("random") == algos.count("stay") == algos.count("oracle") == 2 * 2
    assert len({config.folder_name for config in planned}) == len(planned)
    assert {config.steps for config in planned if config.algo in ("vpg", "dqn")} == {64}


def test_plan_goes_cell_by_cell_and_seed_by_seed():
    planned = [c for c in plan.plan(["vpg", "dqn"], ["fp", "pp"], [0, 0.5], (100, 101), 64) if c.steps]
    cells = [(config.noise, config.task) for config in planned]
    assert cells == sorted(cells)
    assert [config.seed for config in planned] == [100, 100, 101, 101] * 4
    assert [config.algo for config in planned] == ["vpg", "dqn"] * 8


def test_plan_takes_what_is_named_twice_once():
    assert plan.plan(["vpg", "vpg"], ["pp", "pp"], [0, 0.0], [1]) == plan.plan(["vpg"], ["pp"], [0], [1])


def test_default_command_is_the_grid_of_the_protocol(here, monkeypatch):
    planned = []
    (here / "runs").mkdir()

    def nothing_yet(configs, *_):
        planned.extend(configs)
        return []

    monkeypatch.setattr("usbench.compare.runs.report", nothing_yet)
    assert cli.main(["compare", "--report-only"]) == 0
    grid = protocol.read().comparison
    learning = [config for config in planned if config.steps]
    assert len(learning) == 480 and {config.seed for config in learning} == set(range(100, 110))
    assert {config.algo for config in learning} == set(grid.rows)
    assert {(config.task, config.noise) for config in learning} == {
        (task, noise) for task in ("fp", "pp") for noise in (0.0, 0.25, 0.5)
    }


@pytest.mark.parametrize(
    ("table", "n_trials", "expected"),
    [
        ("single-frames", 8 * 2 * 5, {"n_frames": 1, "steps": 16_064, "algo": "ppo"}),
        ("second-network", 8 * 2 * 5, {"n_frames": 4, "steps": 16_064, "algo": "ppo+residual"}),
        ("long", 8 * 2 * 3, {"n_frames": 4, "steps": 64_256, "algo": "ppo"}),
        ("other-tasks", 3 * 4 * 4, {"n_frames": 4, "steps": 32_128, "algo": "ppo", "task": "exam"}),
    ],
)
def test_further_tables_of_the_protocol(table, n_trials, expected):
    planned = [config for config in plan.by_protocol(protocol.read(), table) if config.steps]
    assert len(planned) == n_trials and {config.noise for config in planned} == {0.0}
    assert min(config.seed for config in planned) == 100
    assert any(all(getattr(config, name) == value for name, value in expected.items()) for config in planned)


def test_hyperparameters_of_another_protocol_are_refused(here, capsys, monkeypatch):
    monkeypatch.setattr(protocol, "winners", lambda: {"a2c": {"protocol": "another"}})
    assert cli.main(["compare", *GRID]) == 2
    assert "hyperparameters of a2c were chosen under another protocol" in capsys.readouterr().err
    assert not Path("runs").exists()


def test_agents_that_learn_may_see_and_be_told_something_else():
    planned = plan.by_protocol(
        protocol.read(),
        algos=["double_dqn"],
        tasks=["pp-tracked"],
        noises=[0],
        n_seeds=2,
        n_frames=2,
        senses=["heading", "actions"],
    )
    told = [(config.algo, config.n_frames, tuple(config.environment.get("senses", ()))) for config in planned]
    references = [(name, 4, ("position", "heading")) for name in plan.REFERENCE_POLICIES]
    assert told == references + 2 * [("double_dqn", 2, ("heading", "actions"))]


def test_the_command_says_what_agents_see_and_are_told(here):
    Path("runs").mkdir()
    told = ["--algos", "double_dqn", "--tasks", "pp-tracked", "--noise", "0", "--seeds", "1"]
    assert cli.main(["compare", *told, "--report-only", "--n-frames", "2", "--senses", "actions"]) == 0
    trials = tables.read(Path("leaderboard_files")).trials.set_index("algo")
    settings = trials["settings"]["double_dqn"]
    assert (tables.n_frames(settings), tables.senses(settings)) == (2, ("actions",))


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"n_frames": 2}, "n_frames cannot be chosen on 'fp' with 16064 steps"),
        ({"table": "long", "n_frames": 2}, "n_frames cannot be chosen on 'fp' with 64256 steps"),
        ({"table": "other-tasks", "senses": []}, "senses cannot be chosen on 'exam' with 32128 steps"),
        ({"tasks": ["pp-random"], "senses": []}, "senses cannot be chosen on 'pp-random' with 16064 steps"),
        (
            {"tasks": ["exam-random"], "senses": ["heading"]},
            "agents of 'exam-random' may be told 'actions', and nothing else",
        ),
        (
            {"tasks": ["pp-tracked"], "algos": ["random"], "n_frames": 2, "senses": []},
            "n_frames and senses cannot be chosen where no agent learns",
        ),
        ({"n_frames": 0}, r"n_frames must be a whole number in \[1, 64\], not 0"),
        ({"senses": ["smell"]}, "unknown sense 'smell'"),
    ],
)
def test_what_no_agent_of_a_comparison_can_see_is_refused(options, said):
    with pytest.raises(records.ConfigurationError, match=said):
        plan.by_protocol(protocol.read(), **options)


def test_comparison_from_end_to_end_and_the_same_bytes_once_more(here, capsys):
    assert cli.main(["compare", *GRID]) == 0
    captured = capsys.readouterr()
    assert "5 trials to run, 0 finished already" in captured.err
    assert "[5/5] a2c on pp, noise 0.5, seed 101: finished" in captured.err
    made = captured.out.split()
    assert {"leaderboard.md", "scores.csv"} <= set(made) and all(Path(path).exists() for path in made)
    board = Path("leaderboard.md").read_text()
    for word in ("a2c", "random", "stay", "oracle", "2/2"):
        assert word in board
    before = contents(here)
    assert cli.main(["compare", *GRID]) == 0
    assert "0 trials to run, 5 finished already" in capsys.readouterr().err
    assert contents(here) == before
    # From all trials of the folder, which are those of this comparison.
    shutil.rmtree("leaderboard_files")
    assert cli.main(["leaderboard", "--runs", "runs"]) == 0
    assert contents(here) == before
    capsys.readouterr()
    # From the tables alone, without the trials.
    shutil.rmtree("runs")
    for path in made:
        Path(path).unlink()
    assert cli.main(["leaderboard"]) == 0
    assert capsys.readouterr().out.split() == made
    assert contents(here) == {
        path: data for path, data in before.items() if here / "runs" not in path.parents
    }


def test_leaderboard_without_tables_is_refused_in_one_sentence(here, capsys):
    assert cli.main(["leaderboard"]) == 2
    error = capsys.readouterr().err
    assert "no trials.csv in 'leaderboard_files'" in error and error.count("\n") == 1


def test_leaderboard_of_a_folder_without_trials_is_refused_and_overwrites_nothing(here, capsys):
    Path("leaderboard.md").write_text("mine")
    Path("empty").mkdir()
    assert cli.main(["leaderboard", "--runs", "empty"]) == 2
    error = capsys.readouterr().err
    assert "there is no trial in 'empty'" in error and error.count("\n") == 1
    assert contents(here) == {here / "leaderboard.md": b"mine"}


@pytest.mark.parametrize("option", ["--runs", "--add"])
def test_a_damaged_study_is_refused_before_anything_is_written(here, no_figures, capsys, option):
    runner.run_trial(resolve("stay", "pp"), Path("runs"))
    study = studies.folder_of(Path("runs"), "anna")
    study.mkdir()
    (study / studies.STUDY).write_text('{"study": "anna"}')
    assert cli.main(["leaderboard", option, "runs", "--leaderboard", "mine.md"]) == 2
    assert "is not the record of a study" in capsys.readouterr().err
    assert not list(Path().glob("mine*"))


@pytest.mark.parametrize(
    "own",
    [
        {"probe": LinearArray(n_lines=48)},
        {"imaging": Imaging(dynamic_range_db=50)},
        {"reward": "image"},
    ],
    ids=["probe", "imaging", "reward"],
)
@pytest.mark.parametrize("option", ["--runs", "--add"])
def test_trials_in_another_environment_are_left_out_of_a_leaderboard(here, no_figures, capsys, own, option):
    folders = [
        runner.run_trial(resolve("stay", "pp", **setting), Path("runs")).folder for setting in ({}, own)
    ]
    assert folders[0] != folders[1]
    tables.write(collecting.collect(Path("runs"), [resolve("stay", "pp")]), Path("leaderboard_files"))
    assert cli.main(["leaderboard", option, "runs"]) == 0
    said = "left out, as its anatomy, probe, imaging, reward or senses are not those of the task pp:"
    assert f"{said} {folders[1].name}\n" in capsys.readouterr().err
    assert list(tables.read(Path("leaderboard_files")).trials["trial"]) == [folders[0].name]


def test_agents_that_are_told_other_things_are_in_the_table_of_unseen_phantoms(here, no_figures, capsys):
    small = {"overrides": SMALL["double_dqn"], "n_envs": 1, "seed": 100}
    kept, *left_out = (
        runner.run_trial(resolve("double_dqn", task, **small, **own), Path("runs")).folder.name
        for task, own in (
            ("pp-tracked", {"steps": 64, "senses": ("heading", "actions"), "n_frames": 2}),
            ("pp-random", {"steps": 64, "senses": ("heading",)}),
            ("pp-tracked", {"steps": 64, "probe": LinearArray(n_lines=48)}),
        )
    )
    assert cli.main(["leaderboard", "--runs", "runs"]) == 0
    told = capsys.readouterr().err.splitlines()
    assert sorted(line.rpartition(": ")[2] for line in told) == sorted(left_out)
    (row,) = [line for line in Path("leaderboard.md").read_text().splitlines() if "; 64 steps |" in line]
    own = "told heading, actions; 2 frames; 64 steps"
    assert row.endswith(f"| {ceiling('pp-tracked', ['heading']):.3f} | {own} |")
    assert list(pd.read_csv("scores.csv")["table"].unique()) == ["unseen-phantoms"]
    assert list(tables.read(Path("leaderboard_files")).trials["trial"]) == [kept]


@pytest.mark.parametrize("command", [["compare", *FLOOR[:-2]], ["search", "--algo", "vpg"]])
def test_as_many_trials_run_at_a_time_as_threads_are_allowed(tmp_path, monkeypatch, command):
    asked = []
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("USBENCH_THREADS", "3")
    monkeypatch.setattr(sweep, "run", lambda *_, jobs, **__: asked.append(jobs) or sys.exit(0))
    with pytest.raises(SystemExit):
        cli.main([*command, "--quiet"])
    assert asked == [3]


def test_trials_of_a_folder_are_added_to_the_tables(finished, no_figures, tmp_path, capsys):
    path = tmp_path / "leaderboard.md"
    assert cli.main(["leaderboard", "--runs", str(finished.parent), "--leaderboard", str(path)]) == 0
    before = path.read_bytes()
    # The same trial again changes nothing.
    assert cli.main(["leaderboard", "--add", str(finished.parent), "--leaderboard", str(path)]) == 0
    assert path.read_bytes() == before
    assert capsys.readouterr().err == "in the tables already, with the same numbers: 1 of 1\n"
    other = tmp_path / "more" / "other"
    shutil.copytree(finished, other)
    state = read_state(other)
    state["config"]["seed"] += 1
    write_state(other, state)
    everything = contents(tmp_path)
    assert cli.main(["leaderboard", "--add", str(other.parent), "--leaderboard", str(path)]) == 2
    said = capsys.readouterr().err
    assert "other cannot be added: a comparison takes seeds 100 to 999, not 1, which is of the" in said
    assert said.count("\n") == 1 and contents(tmp_path) == everything
    state["config"]["seed"] = 100
    write_state(other, state)
    everything = contents(tmp_path)
    command = ["leaderboard", "--add", str(other.parent), "--leaderboard", str(path)]
    assert cli.main([*command, "--search", str(tmp_path / "nowhere")]) == 2
    assert "there is no record of a search in" in capsys.readouterr().err
    assert contents(tmp_path) == everything
    assert cli.main(["leaderboard", "--add", str(other.parent), "--leaderboard", str(path)]) == 0
    trials = tables.read(tmp_path / "leaderboard_files").trials
    assert list(trials["trial"]) == [finished.name, "other"]
    assert capsys.readouterr().err == ""


def test_a_trial_of_the_tables_is_replaced_only_if_that_is_asked_for(finished, here, no_figures, capsys):
    mine, folder = finished.parent, Path("leaderboard_files")
    assert cli.main(["leaderboard", "--runs", str(mine)]) == 0
    known = tables.read(folder)
    curves = known.curves.assign(normalized_score=0.25)
    tables.write(tables.Results(known.trials, curves), folder)
    tested = pd.DataFrame(
        [[name, "pp-random", 8, 0.1, -18.0, 0.0] for name in (finished.name, "another")],
        columns=list(held_out.COLUMNS),
    )
    held_out.write(tested, folder)
    before = contents(folder)
    assert cli.main(["leaderboard", "--replace"]) == 2
    assert "--replace says what becomes of added trials" in capsys.readouterr().err
    assert cli.main(["leaderboard", "--add", str(mine)]) == 0
    (score,) = scores.last(known)["normalized_score"]
    told = f"with other numbers (score 0.25000 there, {score:.5f} in {mine}): {finished.name}"
    kept = f"the tables keep their trials: --replace puts those of {mine} in their place"
    assert [told in line for line in capsys.readouterr().err.splitlines()] == [False, True, False]
    assert contents(folder) == before
    assert cli.main(["leaderboard", "--add", str(mine)]) == 0 and kept in capsys.readouterr().err
    assert cli.main(["leaderboard", "--add", str(mine), "--replace"]) == 0
    said = capsys.readouterr().err
    assert told in said and kept not in said
    assert f"was of the older agent and is removed: {finished.name}\n" in said
    pd.testing.assert_frame_equal(tables.read(folder).curves, known.curves)
    assert list(held_out.read(folder)["trial"]) == ["another"]
    # Again: the numbers are the same now, and no file changes.
    after = contents(folder)
    assert cli.main(["leaderboard", "--add", str(mine), "--replace"]) == 0
    assert contents(folder) == after


def test_without_tables_trials_are_added_to_those_that_come_with_the_package(
    finished, here, no_figures, capsys
):
    committed = tables.read(sources.published()).trials
    mine = here / "mine" / "other"
    shutil.copytree(finished, mine)
    assert cli.main(["leaderboard", "--add", "mine"]) == 2  # a seed that is not kept for comparisons
    assert "cannot be added" in capsys.readouterr().err and not Path("leaderboard_files").exists()
    state = read_state(mine)
    state["config"]["seed"] = 100
    write_state(mine, state)
    assert cli.main(["leaderboard", "--add", "mine"]) == 0
    assert "those of the benchmark's own leaderboard are copied there" in capsys.readouterr().err
    trials = tables.read(Path("leaderboard_files")).trials
    assert set(trials["trial"]) == {*committed["trial"], "other"}
    assert (
        Path("leaderboard_files/held_out.csv").read_bytes()
        == (sources.published() / "held_out.csv").read_bytes()
    )
    assert tables.read(sources.published()).trials.equals(committed)


def test_report_of_nothing_is_refused_in_one_sentence(here, capsys):
    told = ["--leaderboard", "new/board.md"]
    assert cli.main(["compare", *FLOOR, "--report-only", "--out", "none", *told]) == 2
    error = capsys.readouterr().err
    assert "there is no folder 'none' with trials" in error and error.count("\n") == 1
    assert list(here.iterdir()) == []
    Path("board_files").mkdir()  # what was there stays
    assert cli.main(["compare", *FLOOR, "--report-only", "--out", "none", "--leaderboard", "board.md"]) == 2
    assert list(here.iterdir()) == [here / "board_files"]


def test_folder_of_trials_that_cannot_be_written_leaves_no_folder_of_tables(here, capsys):
    Path("file").touch()
    assert cli.main(["compare", *FLOOR, "--out", "file/runs"]) == 2
    assert "choose another folder" in capsys.readouterr().err
    assert list(here.iterdir()) == [here / "file"]


def test_failed_trial_is_listed_and_the_status_is_1(here, no_figures, capsys, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("usbench.agents.baselines.Stay._actions", full)
    assert cli.main(["compare", *FLOOR]) == 1
    error = capsys.readouterr().err
    assert error.count("No space left on device") == 2 and "stay on pp, noise 0.5, seed 0 failed" in error
    assert "2 of 6 trials failed" in error.splitlines()[-1]
    assert "failed" in Path("leaderboard.md").read_text()


def test_interrupted_comparison_goes_on_where_it_was(here, no_figures, capsys, monkeypatch):
    real, n_calls = sweep.work, []

    def interrupted(config, out, **options):
        n_calls.append(config)
        if len(n_calls) == 4:
            raise KeyboardInterrupt
        return real(config, out, **options)

    monkeypatch.setattr(sweep, "work", interrupted)
    assert cli.main(["compare", *FLOOR, "--quiet"]) == 130
    assert "interrupted" in capsys.readouterr().err
    # What there is so far, and nothing is run for it.
    assert cli.main(["compare", *FLOOR, "--report-only"]) == 0
    assert "3 of 6" in Path("leaderboard.md").read_text() and len(n_calls) == 4
    capsys.readouterr()
    assert cli.main(["compare", *FLOOR]) == 0
    assert "3 trials to run, 3 finished already" in capsys.readouterr().err


def test_quiet_says_nothing_on_stderr(here, no_figures, capsys):
    assert cli.main(["compare", *FLOOR, "--quiet"]) == 0
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (["--tasks", "ppp"], "'pp'"),
        (["--noise", "1.5"], "1.5"),
        (["--seeds", "0"], "seeds"),
        (["--seeds", "2.5"], "2.5"),
        (
            ["--seeds", "901"],
            "a comparison has at most 900 seeds (100 to 999), not 901.",
        ),
        (["--seeds", "many"], "'many'"),
        (["--steps", "0"], "0"),
        (["--jobs", "0"], "jobs"),
        (["--jobs", "-1"], "jobs"),
        (["--tasks"], "--tasks"),
        (["--sed", "1"], "--sed"),
    ],
)
def test_bad_arguments_are_refused_in_one_sentence(capsys, here, changes, said):
    assert cli.main(["compare", *changes]) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1
    assert not list(here.iterdir())


@pytest.mark.parametrize(
    ("argv", "said"),
    [
        (["compare", "--algos", "ppq"], "'ppo'"),
        (["compare", "--table", "single-frame"], "did you mean 'single-frames'"),
        (["search", "--algo", "stay"], "row of the search"),
        (["search", "--algo", "pop"], "'ppo'"),
        (["search", "--jobs", "0"], "jobs"),
        (["search", "--candidates", "20"], "--candidates"),
        (["search", "--protocol", "none.toml"], "'none.toml' cannot be read"),
    ],
)
def test_unknown_algorithms_and_protocols_are_refused(capsys, here, argv, said):
    assert cli.main(argv) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1
    assert not list(here.iterdir())


def test_leaderboard_that_cannot_be_written_is_refused_before_any_trial(here, capsys):
    (here / "file").write_text("")
    assert cli.main(["compare", *GRID, "--leaderboard", "file/leaderboard.md"]) == 2
    assert "choose another file" in capsys.readouterr().err
    assert not Path("runs").exists()


def test_search_from_end_to_end(here, capsys):
    path = protocols.write(here, ('"a2c", "vpg"', '"a2c"'), ("candidates = 3", "candidates = 2"))
    argv = ["search", "--protocol", str(path), "--quiet", "--jobs", "1"]
    assert cli.main(argv) == 0
    said = capsys.readouterr().out
    winner, stays, following = said.splitlines()
    assert winner.startswith("a2c: candidate ") and stays == "The table of algorithms stays as it is."
    assert following.startswith("next: usbench run --algo a2c --task pp --set learning_rate=")
    assert len(Path("search/a2c.jsonl").read_text().splitlines()) == 1 + 4 + 4
    assert set(records.load("runs/search")["seed"]) == {1000, 1001}
    assert cli.main(argv) == 0 and capsys.readouterr().out == said
    protocols.write(here, ("candidates = 3", "candidates = 4"))
    assert cli.main(argv) == 2
    assert "begun under another protocol" in capsys.readouterr().err
    # What it has said is a command that runs.
    assert cli.main([*following.split()[2:], "--steps", "32", "--quiet"]) == 0


@pytest.mark.parametrize("command", ["compare", "search"])
def test_help_shows_examples(capsys, command):
    assert cli.main([command, "--help"]) == 0
    assert f"  usbench {command} " in capsys.readouterr().out
