"""Print the lowest versions that pyproject.toml allows, as requirements of pip: `make test-lowest`."""

import tomllib
from pathlib import Path

from packaging.requirements import Requirement

# They develop usbench, and do not run it; or no test that runs with the lowest versions needs them.
LEFT_OUT = ("dev", "docs", "bench", "wandb")

project = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())["project"]
groups = [own for name, own in project["optional-dependencies"].items() if name not in LEFT_OUT]
for line in sorted({*project["dependencies"], *(line for group in groups for line in group)}):
    requirement = Requirement(line)
    (floor,) = (one.version for one in requirement.specifier if one.operator == ">=")
    if requirement.name != "torch":  # its lowest version is gigabytes with CUDA's libraries
        print(f"{requirement.name}=={floor}")
