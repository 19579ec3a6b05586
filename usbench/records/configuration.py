"""The configuration of a trial, which gives it its name: equal configurations give equal bits."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Annotated, Any, ClassVar

from annotated_types import Ge, Le, Lt
from pydantic import StringConstraints

# In the configuration of an environment: the file of a custom anatomy. The phantom tells its content.
VOLUME = "volume"
# Frames in one observation: more than an episode has.
MAX_FRAMES = 64
# Environments in step: a phantom each lies in memory.
MAX_ENVS = 1024
# Whole numbers that every reader of JSON takes exactly.
LARGEST_COUNT = 2**53 - 1


@dataclass(frozen=True, kw_only=True)
class TrialConfig:
    """The resolved configuration of one trial; equal configurations give equal bits.

    Attributes:
        task: Name of the task in the suite.
        algo: Name of the algorithm in the zoo.
        noise: Probability p_n of a displacement after a step.
        seed: Trial seed, from which every random stream is spawned.
        steps: Training budget in environment steps, kept exactly (0 for agents that do not learn).
        n_frames: Frames in one observation.
        n_envs: Environments in step during training.
        hyperparameters: Every hyperparameter of the algorithm, after defaults, presets and overrides.
        environment: The environment's own configuration (id, phantom, probe, imaging), as plain values.
    """

    # How a recorded one is checked: see `Trial`.
    __pydantic_config__: ClassVar[dict[str, Any]] = {"strict": True, "allow_inf_nan": False}

    task: str
    algo: Annotated[str, StringConstraints(pattern=r"^[\w.+:-]+$")]
    noise: Annotated[float, Ge(0), Le(1)]
    seed: Annotated[int, Ge(0), Lt(2**32)]
    steps: Annotated[int, Ge(0), Lt(2**53)]
    n_frames: Annotated[int, Ge(1), Le(MAX_FRAMES)] = 4
    hyperparameters: Mapping[str, Any] = field(default_factory=dict)
    environment: Mapping[str, Any] = field(default_factory=dict)
    n_envs: Annotated[int, Ge(1), Le(MAX_ENVS)] = 1

    @property
    def hash(self) -> str:
        """Eight hexadecimal digits that change with any part of the configuration but a file's place."""
        return digest(identity(asdict(self)))

    @property
    def title(self) -> str:
        """Algorithm, task, noise and seed in words."""
        return f"{self.algo} on {self.task}, noise {self.noise:g}, seed {self.seed}"

    @property
    def phantom_set(self) -> str:
        """The fixed set of training phantoms in words, with the digest that names it; "" where none is."""
        phantoms = self.environment.get("phantoms", {})
        if "digest" not in phantoms:
            return ""
        return f"{phantoms['count']} training phantoms (set {phantoms['digest']})"

    @property
    def folder_name(self) -> str:
        """`<task>-p<noise>-<algo>-s<seed>-<hash>`."""
        algo = self.algo.replace(":", ".")  # no colon in a name on Windows
        return f"{self.task}-p{self.noise:g}-{algo}-s{self.seed}-{self.hash}"


def identity(config: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return a configuration without the place of the phantom's file, which may be moved.

    One environment is left out too: trials from before there could be more have the names that they had.
    """
    if config.get("n_envs") == 1:
        config = {name: value for name, value in config.items() if name != "n_envs"}
    environment = config.get("environment", {})
    if VOLUME not in environment:
        return config
    return {**config, "environment": {key: value for key, value in environment.items() if key != VOLUME}}


def digest(value: Mapping[str, Any]) -> str:
    """Return a short name of a configuration, or of a part of one: eight hexadecimal digits."""
    canonical = json.dumps(value, sort_keys=True, separators=(",", ":"), default=str)
    return hashlib.sha256(canonical.encode()).hexdigest()[:8]
