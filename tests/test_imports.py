"""The straight line of modules: who may import whom, read from the sources."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest
from made_tables import made, seeds

from usbench.results import additions, collecting, tables

ROOT = Path(__file__).parents[1]
FOLDERS = {"usbench": "usbench", "usbench.envs": "envs", "usbench.agents": "agents"}
PHYSICS = ("pose", "phantom", "probe", "rf", "bmode", "scanner", "frames")
# Pure readers of records; the terminal's part of it is imported by the command line alone.
READERS = (
    "usbench.records", "usbench.figures.learning_curve", "usbench.figures.plots",
    "usbench.results.leaderboard", "usbench.watch.replay", "usbench.watch.terminal",
    "usbench.report.page", "usbench.cli.output.trial_output", "usbench.cli",
)  # fmt: skip
LEARNING = {"gymnasium", "torch", "stable_baselines3"}
# What all of usbench stands on.
GROUND = (
    "usbench.checks",
    "usbench.atomic",
    "usbench.anchors",
    "usbench.coordinates",
    "usbench.seed_pools",
    "usbench.words",
    "usbench.waiting",
    "usbench.released",
)


def modules():
    return {
        ".".join([package, *path.relative_to(ROOT / folder).with_suffix("").parts]): path
        for package, folder in FOLDERS.items()
        for path in sorted((ROOT / folder).rglob("*.py"))
        if path.stem != "__init__"
    }


def imported(path, *, lazy=True):
    """Names that a module imports: at its top, and inside functions where `lazy`."""
    tree = ast.parse(path.read_text())
    names = set()
    for node in ast.walk(tree) if lazy else tree.body:
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            names |= {node.module} - {"usbench"} | {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def reached(start):
    """Everything that importing `start` imports, through the project's own modules."""
    known, seen, queue = modules(), set(), [start]
    while queue:
        for name in imported(known[queue.pop()], lazy=False) - seen:
            seen.add(name)
            if name in known:
                queue.append(name)
    return seen


@pytest.mark.parametrize("name", PHYSICS)
def test_physics_knows_nothing_of_learning(name):
    tops = {module.split(".")[0] for module in reached(f"usbench.envs.{name}")}
    assert not tops & LEARNING


def test_physics_stands_in_a_line():
    for position, name in enumerate(PHYSICS):
        below = {f"usbench.envs.{later}" for later in PHYSICS[position:]}
        assert not imported(ROOT / "envs" / f"{name}.py") & below, name


def foreign(path, *allowed):
    """What a module imports of the project beside the `allowed` packages."""
    own = {name for name in imported(path) if name.split(".")[0] == "usbench"}
    return {name for name in own if not any(f"{name}.".startswith(f"{one}.") for one in allowed)}


@pytest.mark.parametrize("path", sorted((ROOT / "agents").rglob("*.py")), ids=lambda path: path.stem)
def test_agents_meet_environments_only_through_gymnasium(path):
    assert not foreign(path, "usbench.agents", *GROUND)


@pytest.mark.parametrize("path", sorted((ROOT / "envs").rglob("*.py")), ids=lambda path: path.stem)
def test_environments_import_only_environments(path):
    assert not foreign(path, "usbench.envs", *GROUND)


# What anything that shows results stands on.
BELOW = tuple(
    f"usbench.{name}"
    for name in [
        "anchors",
        "atomic",
        "ceilings",
        "checks",
        "coordinates",
        "records",
        "released",
        "tasks",
        "waiting",
        "words",
    ]
)
SCENE = ("usbench.setting", "usbench.setting_parts", "usbench.own_task", "usbench.suite", "usbench.envs")
# Modules that ask agents, which takes torch.
ASKING = {"watch/advice", "watch/selection", "report/actions"}
# Figures about poses know what a task is.
OF_TASKS = {"episode_ends", "look_alikes", "policy_map", "state_map"}


def shown_by(folder):
    paths = sorted((ROOT / "usbench" / folder).glob("*.py"))
    return pytest.mark.parametrize("path", paths, ids=lambda path: path.stem)


@shown_by("figures")
def test_figures_import_results_and_records_alone(path):
    of_tasks = ("usbench.suite", "usbench.envs") if path.stem in OF_TASKS else ()
    assert not foreign(path, "usbench.figures", "usbench.results", *BELOW, *of_tasks)
    assert not {name.split(".")[0] for name in imported(path)} & LEARNING


@shown_by("watch")
def test_watch_stands_on_figures_and_trials(path):
    stands_on_its_floor(path, "usbench.figures")


@shown_by("report")
def test_report_stands_on_watch_figures_results_and_trials(path):
    stands_on_its_floor(path, "usbench.watch", "usbench.figures", "usbench.results")


def stands_on_its_floor(path, *floors):
    """Trials, and torch with them, are for those modules alone that ask agents."""
    asks = f"{path.parent.name}/{path.stem}" in ASKING
    trials = ("usbench.trials", "usbench.agents") if asks else ()
    assert not foreign(path, f"usbench.{path.parent.name}", *floors, *BELOW, *SCENE, *trials)
    assert asks or not {name.split(".")[0] for name in imported(path)} & (LEARNING - {"gymnasium"})


def test_custom_anatomies_are_one_kind_of_tissue_among_others():
    for path in (ROOT / "envs").rglob("*.py"):
        own = {name for name in imported(path) if name.startswith("usbench.envs.anatomy")}
        assert not own or path.parent.name == "anatomy", path


def test_single_environments_know_nothing_of_vectors():
    for path in (ROOT / "envs").rglob("*.py"):
        own = {name for name in imported(path) if name.startswith("usbench.envs.vector")}
        assert not own or path.parent.name == "vector", path


@pytest.mark.parametrize("name", GROUND)
def test_the_ground_floor_stands_on_nothing_else(name):
    path = ROOT / f"{name.replace('.', '/')}.py"
    assert not foreign(path, *(() if name == "usbench.checks" else GROUND))


def test_readers_of_records_import_no_torch():
    code = (
        "import importlib, sys\n"
        f"for name in {READERS}:\n"
        "    importlib.import_module(name)\n"
        "    assert not {'torch', 'stable_baselines3'} & set(sys.modules), name\n"
    )
    subprocess.run([sys.executable, "-P", "-c", code], check=True)


@pytest.mark.parametrize(
    "path", sorted((ROOT / "usbench" / "results").rglob("*.py")), ids=lambda path: path.stem
)
def test_results_import_only_records_and_the_tables_of_tasks_ceilings_and_algorithms(path):
    # The tables of algorithms and hyperparameters load no torch.
    tables = (
        "usbench.tasks",
        "usbench.ceilings",
        "usbench.agents.zoo",
        "usbench.agents.hyperparameters",
    )
    assert not foreign(path, "usbench.results", "usbench.records", *tables, *GROUND)


@pytest.mark.parametrize(
    "path", sorted((ROOT / "usbench" / "compare").glob("*.py")), ids=lambda path: path.stem
)
def test_comparisons_import_no_page_and_no_command(path):
    # Of agents only the tables, which load no torch.
    agents = ("agents.zoo", "agents.hyperparameters", "agents.search_space")
    allowed = (
        "compare",
        "trials",
        "figures",
        "results",
        "own_task",
        "setting",
        "suite",
        "records",
        "ceilings",
        *agents,
    )
    assert not foreign(path, *(f"usbench.{name}" for name in allowed), *GROUND)


@pytest.mark.parametrize(
    "path", sorted((ROOT / "usbench" / "guide").glob("*.py")), ids=lambda path: path.stem
)
def test_the_guide_imports_no_report_no_comparison_and_no_command(path):
    allowed = (
        "guide",
        "watch",
        "figures",
        "results",
        "trials",
        "setting",
        "suite",
        "records",
        "ceilings",
        "agents",
        "envs",
    )
    assert not foreign(path, *(f"usbench.{name}" for name in allowed), *GROUND)


@pytest.mark.parametrize(
    "path", sorted((ROOT / "usbench" / "datasets").glob("*.py")), ids=lambda path: path.stem
)
def test_data_sets_stand_on_trials(path):
    allowed = ("datasets", "trials", "setting", "records", "envs")
    assert not foreign(path, *(f"usbench.{name}" for name in allowed), *GROUND)


def test_commands_on_records_load_no_torch_and_from_tables_no_simulator(finished, tmp_path, monkeypatch):
    # It is checked where it is set, by a module of the simulator that imports nothing.
    monkeypatch.delenv("USBENCH_THREADS", raising=False)
    known = made(*seeds("vpg", [0.5, 0.6]))
    runs = str(finished.parent)
    # A trial that is new needs a seed that is kept for comparisons.
    known = additions.joined(known, collecting.collect(finished.parent))
    tables.write(known, tmp_path / "leaderboard_files")
    simulator, torch = {"numba", "cv2", "usbench.envs"}, {"torch", "stable_baselines3"}
    commands = [
        (["leaderboard"], simulator | torch),
        (["plot", str(finished)], simulator | torch),
        (["leaderboard", "--add", runs], torch),
        (["leaderboard", "--runs", runs], torch),
    ]
    code = (
        "import sys\n"
        "from usbench import cli\n"
        f"for argv, needless in {commands}:\n"
        "    assert cli.main(argv) == 0\n"
        "    assert not needless & set(sys.modules), argv\n"
    )
    subprocess.run([sys.executable, "-P", "-c", code], cwd=tmp_path, check=True)
