"""Models from anyone: weights are read as numbers alone, so that no file can run code when it is opened.

Stable-Baselines3's `load` unpickles objects, and a pickle can do anything. Here the agent is built from the
zoo, for the configuration that the trial recorded, and only its tensors come from the file.
"""

import contextlib
import dataclasses
import io
import zipfile
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import DummyVecEnv

from usbench import records, released
from usbench.agents import plugins, zoo
from usbench.records import ConfigurationError, Trial, TrialConfig
from usbench.setting import Setting
from usbench.trials.configuration import resolve
from usbench.trials.learning import make_agent
from usbench.words import in_one_line

WEIGHTS = "policy.pth"
# Behind the name of a value network: its target network.
TARGET = "_target"


@dataclass(frozen=True)
class Loaded:
    """An agent that acts (`predict`), and the configuration of the trial that it comes from."""

    agent: Any
    config: TrialConfig

    def make_env(self, *, render_mode: str | None = None) -> gym.Env[Any, Any]:
        """Make an environment of the agent's task that shows what the agent saw in training.

        It has the trial's noise and phantom, stacks as many frames, and tells the same senses.

        Args:
            render_mode: None or "rgb_array".
        """
        return Setting.recorded(self.config).make_env(render_mode=render_mode)


def load_agent(path: str | Path, *, algo: str | None = None, task: str | None = None) -> Loaded:
    """Open a trial, a `.zip` that Stable-Baselines3 saved, or an agent of the package; run nothing in it.

    Args:
        path: Trial folder, zip file, or the name of an agent that comes with the package ("best:pp"). Where
            `trial.json` lies beside the zip, it says algorithm and task.
        algo: Algorithm of a zip without `trial.json`; beside one it must be the same. An algorithm of your
            own ("module:name") is imported only if it is named here, since importing it runs its code.
        task: Task of a zip without `trial.json`; beside one it must be the same.

    Returns:
        The agent, for acting: it has no memory of what it learnt from. Agents that do not learn have no
        weights to be read.

    Raises:
        ConfigurationError: If there is no model, it does not fit the task, or it holds more than numbers; one
            sentence says which.
    """
    path = released.place(path)
    folder, file = (path, records.model_in(path)) if path.is_dir() else (path.parent, path)
    if (folder / records.TRIAL).is_file():
        config = _recorded(folder, algo, task)
    elif path.is_dir() or not (path.exists() or (algo and task)):
        raise records.no_trial(path)
    elif algo is None or task is None:
        raise ConfigurationError(
            f"{str(path)!r} has no {records.TRIAL} beside it: say its algorithm and its task."
        )
    else:
        config = resolve(algo, task)
    try:
        agent = _build(config)
    except ConfigurationError:
        raise
    except Exception as error:  # frames that fill the memory, and whatever else a stranger's record says
        raise ConfigurationError(f"the agent of {str(path)!r} cannot be made ({_words(error)}).") from error
    if zoo.entry(config.algo).learns:
        if not isinstance(agent, BaseAlgorithm):
            raise ConfigurationError(
                f"a model of {config.algo} cannot be opened safely: only models of Stable-Baselines3 are "
                "read without running code in them; open it with the code that saved it."
            )
        _load_weights(agent, file, config)
    return Loaded(agent, config)


def _recorded(folder: Path, algo: str | None, task: str | None) -> TrialConfig:
    """Return the configuration in `trial.json`, every value checked: it may come from a stranger too."""
    path = folder / records.TRIAL
    try:
        config = Trial.read(folder).config
        for what, own, asked in (("algorithm", config.algo, algo), ("task", config.task, task)):
            if asked not in (None, own):
                raise ConfigurationError(f"{path} records the {what} {own!r}, not {asked!r}.")
        foreign = config.algo not in zoo.ZOO and config.algo not in plugins.registered(zoo.ZOO)
        if foreign and ":" in config.algo and algo is None:
            raise ConfigurationError(
                f"{path} names an algorithm outside this package, {config.algo!r}, whose code would run: "
                f"in Python, usbench.load_agent(..., algo={config.algo!r}) opens it, if you trust it."
            )
        hyperparameters = zoo.hyperparameters(config.algo, config.task, config.hyperparameters)
        return dataclasses.replace(config, hyperparameters=hyperparameters)
    except ConfigurationError:
        raise
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        told = str(error)  # the reader of records names the file itself
        why = told if told.startswith(str(path)) else f"{path} does not record a trial ({_words(error)})."
        raise ConfigurationError(why) from error


def _build(config: TrialConfig) -> Any:
    setting = Setting.recorded(config)
    hyperparameters = dict(config.hyperparameters)
    # Acting remembers nothing: a replay buffer as large as the file says could fill the memory.
    if "buffer_size" in hyperparameters:
        hyperparameters["buffer_size"] = 1
    env = DummyVecEnv([setting.make_env])
    return make_agent(setting, config.algo, env, config.seed, hyperparameters)


def _misfits(
    tensors: Mapping[str, torch.Tensor], own: Mapping[str, torch.Tensor], config: TrialConfig
) -> Iterator[str]:
    """Yield in words what `tensors` have otherwise than the agent's `own` weights."""
    for name in own:
        if name not in tensors:
            yield f"it has no {name}"
    for name in tensors:
        if name not in own:
            yield f"{name} is not part of it"
    for name, tensor in own.items():
        if tensors[name].shape != tensor.shape:
            shapes = f"{tuple(tensors[name].shape)} instead of {tuple(tensor.shape)}"
            yield f"{name} has shape {shapes}{_why_other(tensors[name], tensor, config)}"


def _load_weights(agent: BaseAlgorithm, file: Path, config: TrialConfig) -> None:
    own = agent.policy.state_dict()
    size = sum(tensor.nbytes for tensor in own.values())
    # Names and padding beside the numbers; more would be another network, or made to fill the memory.
    limit = 2 * size + 1_000_000
    tensors = _arrays(file, limit, own) if file.suffix == ".npz" else _tensors(file, limit)
    if misfit := next(_misfits(tensors, own, config), None):
        raise ConfigurationError(
            f"the model in {str(file)!r} does not fit {config.algo} on {config.task}: {misfit}."
        )
    try:
        agent.policy.load_state_dict(tensors)
    except Exception as error:  # of numbers that are not kept one by one, as sparse ones
        raise ConfigurationError(f"the model in {str(file)!r} cannot be used ({_words(error)}).") from error
    if not all(bool(torch.isfinite(tensor).all()) for tensor in agent.policy.state_dict().values()):
        raise ConfigurationError(f"the model in {str(file)!r} has weights that are not finite numbers.")
    agent.policy.set_training_mode(False)


def _arrays(file: Path, limit: int, names: Iterable[str]) -> dict[str, torch.Tensor]:
    """Read the weights of a released agent, at most `limit` bytes.

    Only arrays of numbers are read: `allow_pickle=False` refuses objects, which alone could run code. `names`
    are those of the policy's weights. Of a network and its target network the file has the one that acts
    greedily; the other becomes a copy.
    """
    with _archive(file) as archive:
        _check_size(archive.infolist(), limit, file)
    try:
        with np.load(file, allow_pickle=False) as arrays:
            tensors = {name: torch.from_numpy(arrays[name]) for name in arrays.files}
    except Exception as error:
        raise ConfigurationError(
            f"{str(file)!r} holds something else than arrays of numbers ({_words(error)})."
        ) from error
    copied = {name: tensors[twin] for name in names if (twin := twin_of(name)) in tensors}
    return {**copied, **tensors}


def twin_of(name: str) -> str:
    """Return the name of the same weight in the target network of its network, or in whose target it is."""
    network, _, rest = name.partition(".")
    is_target = network.endswith(TARGET)
    return f"{network.removesuffix(TARGET) if is_target else network + TARGET}.{rest}"


def _why_other(found: torch.Tensor, own: torch.Tensor, config: TrialConfig) -> str:
    """Say what else an agent may have seen, where a layer has other inputs and as many outputs."""
    if found.ndim < 2 or found.ndim != own.ndim or len(found) != len(own):
        return ""
    senses = ", ".join(config.environment.get("senses", ())) or "none"
    return f", as after training with other senses than {senses}, or with other than {config.n_frames} frames"


def _tensors(file: Path, limit: int) -> dict[str, torch.Tensor]:
    """Read the tensors of a policy, at most `limit` bytes, out of a model file."""
    with _archive(file) as archive:
        if WEIGHTS not in archive.namelist():
            raise ConfigurationError(
                f"{str(file)!r} is not a model of Stable-Baselines3: no {WEIGHTS} in it."
            )
        _check_size([archive.getinfo(WEIGHTS)], limit, file)
        content = io.BytesIO(archive.read(WEIGHTS))
    if not zipfile.is_zipfile(content):
        raise ConfigurationError(
            f"{WEIGHTS} in {str(file)!r} is no file of torch.save: another kind of pickle could run code "
            "and is not opened."
        )
    try:
        with zipfile.ZipFile(content) as archive:
            _check_size(archive.infolist(), limit, file)
        content.seek(0)
        tensors = torch.load(content, map_location="cpu", weights_only=True)
    except ConfigurationError:
        raise
    except Exception as error:
        raise ConfigurationError(_why_unreadable(content, file)) from error
    if not isinstance(tensors, dict) or not all(
        isinstance(name, str) and isinstance(tensor, torch.Tensor) for name, tensor in tensors.items()
    ):
        raise ConfigurationError(f"{WEIGHTS} in {str(file)!r} holds something else than named tensors.")
    return tensors


def _why_unreadable(content: io.BytesIO, file: Path) -> str:
    """Say what the pickle wanted to call, found by reading it, not by running it."""
    content.seek(0)
    calls: list[str] = []
    with contextlib.suppress(Exception):
        calls = sorted(torch.serialization.get_unsafe_globals_in_checkpoint(content))
    if not calls:
        return f"{WEIGHTS} in {str(file)!r} is broken: its tensors cannot be read."
    return (
        f"{str(file)!r} is refused and nothing in it was run: {WEIGHTS} should hold numbers alone, but "
        f"opening it would run code ({', '.join(calls)})."
    )


@contextlib.contextmanager
def _archive(file: Path) -> Iterator[zipfile.ZipFile]:
    """Open a zip whose names stay inside of it, although nothing is ever unpacked."""
    if not file.is_file():
        raise ConfigurationError(f"there is no model {str(file)!r}.")
    try:
        with zipfile.ZipFile(file) as archive:
            for name in archive.namelist():
                inside = PurePosixPath(name), PureWindowsPath(name)
                if any(path.anchor or ".." in path.parts for path in inside):
                    raise ConfigurationError(
                        f"{str(file)!r} is refused: the name {name!r} in it leads out of the archive."
                    )
            yield archive
    except ConfigurationError:
        raise
    # Broken, encrypted, cut off, unreadable; and each way of packing has errors of its own.
    except Exception as error:
        raise ConfigurationError(f"{str(file)!r} is not a readable zip file ({_words(error)}).") from error


def _check_size(members: list[zipfile.ZipInfo], limit: int, file: Path) -> None:
    size = sum(member.file_size for member in members)
    if size > limit:
        raise ConfigurationError(
            f"the model in {str(file)!r} does not fit: its weights would take {size} bytes, this network's "
            f"at most {limit}."
        )


def _words(error: Exception) -> str:
    """Return an error in one line, as it stands in brackets: without a full stop."""
    return in_one_line(error, with_type=True).rstrip(".: ")
