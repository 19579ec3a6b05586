"""What an installation gets: every module of the three folders, and a command."""

import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

from usbench.results import additions

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
FOLDERS = {
    "usbench": "usbench",
    "usbench.envs": "envs",
    "usbench.agents": "agents",
    "usbench.published": "leaderboard_files",
}


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """A wheel, built from a copy so that the working tree stays clean."""
    source = tmp_path_factory.mktemp("source")
    for name in FOLDERS.values():
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
    (source / FOLDERS["usbench.published"] / additions.UNVERIFIED).touch()  # which need not be there
    for name in ("pyproject.toml", "README.md", "LICENSE", "usbench_command.py"):
        if (ROOT / name).exists():
            shutil.copy(ROOT / name, source)
    subprocess.run(
        [
            sys.executable,
            "-m",
            "pip",
            "wheel",
            "--quiet",
            "--no-deps",
            "--no-build-isolation",
            "-w",
            "dist",
            ".",
        ],
        cwd=source,
        check=True,
        capture_output=True,
    )
    (path,) = (source / "dist").glob("*.whl")
    with zipfile.ZipFile(path) as archive:
        yield archive


def test_wheel_holds_exactly_the_modules_of_the_folders(wheel):
    expected = {
        f"{package.replace('.', '/')}/{module.relative_to(ROOT / folder).as_posix()}"
        for package, folder in FOLDERS.items()
        for module in (ROOT / folder).rglob("*.py")
    }
    assert {name for name in wheel.namelist() if name.endswith(".py")} == expected | {"usbench_command.py"}


def test_wheel_is_typed_licensed_and_has_the_command(wheel):
    names = wheel.namelist()
    assert {"weights.npz", "trial.json", "card.md"} <= {
        name.rpartition("/")[2] for name in names if name.startswith("usbench/trained/best-pp/")
    }
    assert "usbench/py.typed" in names and "usbench/probes/l7-4.toml" in names
    assert any(name.endswith("licenses/LICENSE") for name in names)
    (entry_points,) = (name for name in names if name.endswith("entry_points.txt"))
    assert "usbench = usbench_command:main" in wheel.read(entry_points).decode()


def test_wheel_holds_the_tables_of_the_committed_leaderboard_and_none_of_its_figures(wheel):
    held = {name.rpartition("/")[2] for name in wheel.namelist() if name.startswith("usbench/published/")}
    held.remove("__init__.py")
    held.remove(additions.UNVERIFIED)
    committed = {path.name for path in (ROOT / FOLDERS["usbench.published"]).glob("*.csv")}
    assert held == committed >= {"trials.csv", "curves.csv"}


def test_every_folder_with_modules_is_a_listed_package():
    folders = {
        path.parent.relative_to(ROOT).as_posix()
        for folder in FOLDERS.values()
        for path in (ROOT / folder).rglob("*.py")
    }
    packages = PROJECT["tool"]["setuptools"]["packages"]
    own = PROJECT["tool"]["setuptools"]["package-dir"]
    assert {own.get(name, name.replace(".", "/")) for name in packages} == folders


def test_every_dependency_is_pinned_for_any_index():
    pins = dict(
        line.split("==") for line in (ROOT / "constraints.txt").read_text().splitlines() if "==" in line
    )
    names = {name.lower().replace("_", "-") for name in pins}
    extras = PROJECT["project"]["optional-dependencies"]
    # That of the extra "bench" has its version where it is declared.
    own = [one for name, extra in extras.items() if name != "bench" for one in extra]
    declared = PROJECT["project"]["dependencies"] + own
    assert {requirement.split(">=")[0] for requirement in declared} <= names
    # A local version such as +cpu exists on one index only.
    assert not [version for version in pins.values() if "+" in version]


def test_versions_agree():
    import usbench

    assert usbench.__version__ == PROJECT["project"]["version"]
    assert f"version: {usbench.__version__}\n" in (ROOT / "CITATION.cff").read_text()
