"""What is trained for each table: the agent as it is and changed, on sets of phantoms, and for longer."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import product
from typing import Any

from unseen_phantoms import agents
from unseen_phantoms.agents import AGENT
from usbench.records import TrialConfig
from usbench.trials.configuration import resolve

TASK = "pp-tracked"
SETTING: Mapping[str, Any] = {"n_frames": 2, "senses": ("position", "heading", "actions")}
# Of training phantoms in a fixed set; None for a new phantom in every episode.
COUNTS = (1, 20, 200, 2000, None)


@dataclass(frozen=True)
class Variant:
    """A row of a table: an algorithm, and what differs from its defaults and from `SETTING`."""

    title: str
    algo: str = AGENT
    overrides: Mapping[str, Any] = field(default_factory=dict)
    setting: Mapping[str, Any] = field(default_factory=dict)

    @property
    def n_phantoms(self) -> int | None:
        """How many training phantoms there are, None for a new one in every episode."""
        return self.setting.get("n_phantoms")

    def config(self, steps: int, seed: int) -> TrialConfig:
        """Return the configuration of one of its trials."""
        own = {**SETTING, **self.setting}
        return resolve(self.algo, TASK, seed=seed, steps=steps, overrides=self.overrides, **own)


@dataclass(frozen=True)
class Study:
    """A table: its rows, and the training steps and the number of seeds of each."""

    variants: tuple[Variant, ...]
    steps: tuple[int, ...]
    n_seeds: int


def _row(title: str, name: str, **overrides: Any) -> Variant:
    """Return the variant of a row of `agents`."""
    return Variant(title, f"{agents.__name__}:{name}", overrides)


ABLATIONS = (
    Variant("as it is"),
    _row("no symmetries", "NO_VIEWS"),
    _row("replay alone: angles negated", "ANGLES_NEGATED"),
    _row("replay alone: turned about, picture mirrored", "TURNED_MIRRORED"),
    _row("replay alone: turned about, x negated", "TURNED_X_NEGATED"),
    _row("replay alone: all symmetries", "ALL_REMEMBERED"),
    _row("replay alone: all symmetries, shifts of 2 pixels", "ALL_REMEMBERED", max_shift_px=2),
    _row("network alone: all symmetries", "ALL_IN_NETWORK"),
    _row("no symmetries, shifts of 2 pixels", "NO_VIEWS", max_shift_px=2),
    Variant("shifts of 2 pixels", overrides={"max_shift_px": 2}),
    Variant("returns of one step", overrides={"return_steps": 1}),
    _row("the paper's trunk", "PAPERS_TRUNK"),
    _row("one average over the picture", "ONE_AVERAGE"),
    _row("layer norm", "LAYER_NORM"),
    _row("no norm", "NO_NORM"),
    Variant("one frame", setting={"n_frames": 1}),
    Variant("without the last action", setting={"senses": ("position", "heading")}),
    Variant("without position and heading", setting={"senses": ("actions",)}),
    Variant("ppo_asymmetric", "ppo_asymmetric"),
    Variant("ppo_asymmetric, symmetries in rollouts", "ppo_asymmetric", {"symmetric_views": True}),
)
GAP = tuple(
    Variant(algo, algo, setting={"n_phantoms": count})
    for algo, count in product((AGENT, "distilled"), COUNTS)
)

STUDIES: Mapping[str, Study] = {
    "ablations": Study(ABLATIONS, steps=(50_000,), n_seeds=3),
    "gap": Study(GAP, steps=(50_000,), n_seeds=3),
    "scaling": Study((Variant(AGENT),), steps=(100_000, 300_000, 1_000_000), n_seeds=2),
}
