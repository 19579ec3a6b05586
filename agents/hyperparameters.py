"""Type and range of every hyperparameter, in one place: what `VPG(...)`, the table and `--set` accept."""

from collections.abc import Mapping
from dataclasses import dataclass
from numbers import Integral
from typing import TypeAlias

from usbench.checks import interval, number, whole_interval, whole_number

Value: TypeAlias = bool | int | float


@dataclass(frozen=True)
class Boolean:
    """A hyperparameter that is on or off."""

    def __str__(self) -> str:
        """What is allowed, for error messages."""
        return "true or false"

    def parse(self, text: str) -> object:
        """`text` as a truth value, or unchanged where it is none."""
        return {"true": True, "false": False}.get(text.strip().lower(), text)

    def check(self, name: str, value: object) -> bool:
        """`value` itself; TypeError unless it is a truth value."""
        if not isinstance(value, bool):
            raise TypeError(f"{name} must be {self}, not {value!r}.")
        return value


@dataclass(frozen=True)
class Whole:
    """A whole number in [low, high]."""

    low: int
    high: int

    def __str__(self) -> str:
        """What is allowed, for error messages."""
        return whole_interval(self.low, self.high)

    def parse(self, text: str) -> object:
        """`text` as an integer, or unchanged where it is none."""
        try:
            return int(text)
        except ValueError:
            return text

    def check(self, name: str, value: object) -> int:
        """`value` as int; TypeError or ValueError unless it is a whole number in the range, and no float."""
        if not isinstance(value, Integral):
            raise TypeError(f"{name} must be {self}, not {value!r}.")
        return whole_number(name, value, self.low, self.high)


@dataclass(frozen=True)
class Number:
    """A number in [low, high]; without `low` itself where `above`, without `high` where `below`."""

    low: float
    high: float
    above: bool = False
    below: bool = False

    def __str__(self) -> str:
        """What is allowed, for error messages."""
        return interval(self.low, self.high, above=self.above, below=self.below)

    def parse(self, text: str) -> object:
        """`text` as a float, or unchanged where it is none."""
        try:
            return float(text)
        except ValueError:
            return text

    def check(self, name: str, value: object) -> float:
        """`value` as float; TypeError or ValueError unless it is a number in the range."""
        return number(name, value, low=self.low, high=self.high, above=self.above, below=self.below)


RANGES: dict[str, Boolean | Whole | Number] = {
    "learning_rate": Number(0.0, 1.0, above=True),
    "final_learning_rate": Number(0.0, 1.0),
    "value_learning_rate": Number(0.0, 1.0, above=True),
    # A rollout lies in memory: 65 536 stacks of four frames are 3.8 GB.
    "n_steps": Whole(2, 65_536),
    "n_value_steps": Whole(1, 10_000),
    "gamma": Number(0.0, 1.0, above=True),
    "gae_lambda": Number(0.0, 1.0),
    "initial_value": Number(-1e9, 1e9),
    "adam_beta1": Number(0.0, 1.0, below=True),
    "batch_size": Whole(2, 65_536),
    "n_epochs": Whole(1, 1_000),
    "clip_range": Number(0.0, 1.0, above=True),
    "ent_coef": Number(0.0, 10.0),
    "vf_coef": Number(0.0, 10.0),
    "max_grad_norm": Number(0.0, 1e6, above=True),
    "normalize_advantage": Boolean(),
    "use_rms_prop": Boolean(),
    "target_kl": Number(0.0, 10.0, above=True),
    "cg_max_steps": Whole(1, 1_000),
    "cg_damping": Number(0.0, 10.0),
    "sub_sampling_factor": Whole(1, 1_000),
    "n_critic_updates": Whole(1, 1_000),
    "buffer_size": Whole(1, 10_000_000),
    "learning_starts": Whole(0, 10_000_000),
    "train_freq": Whole(1, 100_000),
    "gradient_steps": Whole(1, 10_000),
    "target_update_interval": Whole(1, 10_000_000),
    "tau": Number(0.0, 1.0, above=True),
    "return_steps": Whole(1, 100),
    "max_shift_px": Whole(0, 100),
    # An action looks at 2 n + 1 pictures.
    "greedy_shift_px": Whole(0, 10),
    "symmetric_views": Boolean(),
    "largest_cost": Number(0.0, 1e6, above=True),
    "exploration_fraction": Number(0.0, 1.0, above=True),
    "exploration_initial_eps": Number(0.0, 1.0),
    "exploration_final_eps": Number(0.0, 1.0),
}


def check(name: str, value: object) -> Value:
    """`value` in the declared type of the hyperparameter `name`.

    Raises:
        TypeError: `value` has another type than the one declared in `RANGES`.
        ValueError: `value` is out of range.
    """
    return RANGES[name].check(name, value)


def parse(name: str, text: str) -> Value:
    """The hyperparameter `name` written as `text`, as on a command line; raises as `check` does."""
    return check(name, RANGES[name].parse(text))


def as_set(values: Mapping[str, Value | None]) -> list[str]:
    """Return hyperparameters as `--set` takes them, "gamma=0.9" for example, as `parse` reads them back."""
    return [f"{name}={_as_text(value)}" for name, value in values.items()]


def _as_text(value: Value | None) -> str:
    """Return a value as short as it stays the same number."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float) and float(short := f"{value:g}") == value:
        return short
    return str(value)
