"""Data sets in the format of Minari (Younis et al. 2024), with a card that says what is in them."""

import contextlib
import os
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from usbench import records
from usbench.anchors import Anchors
from usbench.atomic import atomic_path, move_whole, scratch_folder
from usbench.checks import ConfigurationError, as_configuration_error, check_seed, install, whole_number
from usbench.datasets import card, episodes
from usbench.datasets.episodes import Played
from usbench.envs.anatomy.points import memory_bytes
from usbench.setting import Setting
from usbench.waiting import duration

# Where Minari looks for data sets; its own default is ~/.minari/datasets.
PLACE = "MINARI_DATASETS_PATH"
CARD = "card.md"
# The file of the episodes, as Minari names it.
DATA = "main_data.hdf5"
MAX_EPISODES = 1_000_000


def check_installed() -> None:
    """Raise ConfigurationError if Minari is missing."""
    if find_spec("minari") is None:
        raise ConfigurationError(f"data sets are written by Minari: {install('minari')}.")


def write(
    task: str,
    agent: str,
    n_episodes: Any,
    *,
    noise: Any = 0.0,
    seed: Any = 0,
    out: Path | None = None,
    tell: Callable[[str], None] = lambda _: None,
) -> tuple[str, Path]:
    """Play episodes and write them as a data set of Minari; the same arguments give the same episodes.

    Args:
        task: Name of the task.
        agent: "oracle", "best", "random", "mixed" (the three in turn), the folder of a trial, or the name of
            an agent of the package.
        n_episodes: How many episodes.
        noise: Probability of a slip after each action.
        seed: From which the seeds of the episodes are drawn.
        out: Folder of data sets; None for that of Minari.
        tell: Told in words what is being done, and for how long.

    Returns:
        The name by which `minari.load_dataset` finds the data set, and its folder, which is there whole or
        not at all.

    Raises:
        ConfigurationError: If a value is not allowed, Minari is missing, or the data set is there already.
    """
    setting = Setting(task=task, noise=noise)
    with as_configuration_error():
        n_episodes, seed = whole_number("episodes", n_episodes, 1, MAX_EPISODES), check_seed(seed)
    if out is not None:
        records.check_writable(out)
    _check_memory(setting, n_episodes)
    opened = {episodes.shown(who): episodes.open_agent(who, setting, seed) for who in episodes.names(agent)}
    check_installed()
    name = dataset_name(setting, agent, seed)
    # Last of what may be refused: it tries to make folders.
    with _place(out):
        folder = _new_folder(name)
    setting, played = _played(setting, opened, n_episodes, seed, tell)
    tell("writing the data set")
    anchors = setting.anchors()
    # Its name begins with a dot, so that Minari passes over what a killed process leaves.
    with _gone_if_empty(folder.parent), scratch_folder(folder) as scratch:
        with _place(scratch):
            _create(name, played, setting, anchors)
        made = scratch / name
        text = card.text(name, setting, agent, anchors, played, seed, size_bytes(made))
        (made / CARD).write_bytes(text.encode())
        _publish(name, made, folder)
    return name, folder


def _publish(name: str, made: Path, folder: Path) -> None:
    """Move a data set to its `folder`, after the files that Minari keeps of its namespace.

    Raises:
        ConfigurationError: If another process has written one there meanwhile.
    """
    for path in made.parent.iterdir():
        if path.is_file() and not (folder.parent / path.name).exists():
            move_whole(path, folder.parent / path.name)
    try:
        made.replace(folder)
    except OSError as error:
        raise (_there_already(name, folder) if _holds_files(folder) else error) from error


def _holds_files(folder: Path) -> bool:
    return folder.is_dir() and any(folder.iterdir())


def _there_already(name: str, folder: Path) -> ConfigurationError:
    return ConfigurationError(
        f"there is a data set {name!r} in {str(folder)!r} already: remove it, or choose another folder."
    )


def dataset_name(setting: Setting, agent: str, seed: int = 0) -> str:
    """Return the name of a data set, "usbench/pp/best-v0"; noise (in per cent) and seed follow the agent."""
    own = "".join(letter if letter.isalnum() else "-" for letter in Path(agent).resolve().name)
    noise = f"-noise{100 * setting.noise:.12g}".replace(".", "_") if setting.noise else ""
    return f"usbench/{setting.task}/{own}{noise}{f'-seed{seed}' if seed else ''}-v0"


def _check_memory(setting: Setting, n_episodes: int) -> None:
    """Raise ConfigurationError where the episodes, which are written at once, do not fit into memory."""
    # Each frame once as it was seen, and once in the array of its episode.
    frame = setting.imaging.height_px * setting.imaging.width_px
    needed, there = 2 * n_episodes * (setting.guidance.n_steps + 1) * frame, memory_bytes()
    if needed > there:
        raise ConfigurationError(
            f"{n_episodes} episodes need some {needed / 1e9:.2g} GB of memory, and this machine has "
            f"{there / 1e9:.2g} GB: write several data sets, with other seeds."
        )


@contextlib.contextmanager
def _place(out: Path | None) -> Iterator[None]:
    """Let Minari look for data sets in `out`."""
    before = os.environ.get(PLACE)
    if out is not None:
        os.environ[PLACE] = str(out.resolve())
    try:
        yield
    finally:
        if out is not None and before is None:
            del os.environ[PLACE]
        elif before is not None:
            os.environ[PLACE] = before


@contextlib.contextmanager
def _gone_if_empty(folder: Path) -> Iterator[None]:
    """Make `folder` and those above it; afterwards those are gone that were not there and hold nothing."""
    made = [place for place in (folder, *folder.parents) if not place.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        yield
    finally:
        for place in made:
            with contextlib.suppress(OSError):  # which says that the folder holds something
                place.rmdir()


def _new_folder(name: str) -> Path:
    """Return the folder of a new data set, which can be made, and is not there yet.

    Raises:
        ConfigurationError: If it cannot be made, or holds files already.
    """
    from minari.storage import get_dataset_path

    try:
        with _gone_if_empty(Path(os.environ.get(PLACE, ""))):
            folder = Path(get_dataset_path(name))  # makes the folder of all data sets
            records.check_writable(folder.parent)
    except OSError as error:
        raise records.unwritable(Path(error.filename or name), error) from error
    if _holds_files(folder):
        raise _there_already(name, folder)
    return folder


def _played(
    setting: Setting,
    opened: Mapping[str, tuple[Any, Setting]],
    n_episodes: int,
    seed: int,
    tell: Callable[[str], None],
) -> tuple[Setting, list[Played]]:
    """Play all episodes with the agents, opened by `episodes.open_agent`, in turn.

    Returns:
        The setting with what the agents are told, and the episodes in the data set's order.
    """
    # At most one agent has learned; the others need no observation, and show what it is told.
    told_to = next((own for _, own in opened.values() if own.senses != setting.senses), setting)
    whom = ", ".join(opened)
    tell(f"{n_episodes} episode{'' if n_episodes == 1 else 's'} of {setting.task}, played by {whom}")
    if setting.row.every_frame and not setting.row.phantoms:
        if not setting.evaluation_frames().are_kept():
            tell("simulating the frames that are not kept yet")
        setting.prepare_frames()
    seeds = np.random.SeedSequence(seed).generate_state(n_episodes).astype(int).tolist()
    played: dict[int, Played] = {}
    begun, told = time.monotonic(), 0.0
    for part, (name, (acting, seen)) in enumerate(opened.items()):
        numbers = range(part, n_episodes, len(opened))
        shown = replace(seen, senses=told_to.senses)
        own = episodes.play(acting, name, shown, [seeds[number] for number in numbers])
        for number, episode in zip(numbers, own, strict=True):
            played[number] = episode
            since = time.monotonic() - begun
            if since - told > 5:
                told, left = since, since / len(played) * (n_episodes - len(played))
                tell(f"episode {len(played)} of {n_episodes}, {duration(left)} to go")
    return told_to, [played[number] for number in range(n_episodes)]


def _create(name: str, played: Sequence[Played], setting: Setting, anchors: Anchors) -> None:
    import minari

    who = list(dict.fromkeys(episode.agent for episode in played))
    env = episodes.make_env(setting)
    with warnings.catch_warnings():
        # Minari asks for an address and a link, which a data set that somebody makes at home has not.
        warnings.filterwarnings("ignore", "`(code_permalink|author_email)` is set to None")
        dataset = minari.create_dataset_from_buffers(
            name,
            [_buffer(number, episode, who.index(episode.agent)) for number, episode in enumerate(played)],
            env=env,
            eval_env=env,
            algorithm_name=", ".join(who),
            author="usbench contributors",
            description=card.description(setting, who),
            ref_min_score=anchors.random,
            ref_max_score=anchors.optimal,
            requirements=[f"usbench>={version('usbench')}"],
            data_format="hdf5",
            jpeg_encoding=False,  # a frame's bits are what an agent sees
        )
    env.close()
    _compress(Path(str(dataset.storage.data_path)) / DATA)
    dataset.storage.update_metadata({"dataset_size": dataset.storage.get_size()})


def _compress(path: Path) -> None:
    """Write a file of Minari again with its arrays compressed: it leaves room for episodes to grow."""
    import h5py

    with atomic_path(path) as temporary, h5py.File(path) as source, h5py.File(temporary, "w") as packed:

        def copy(name: str, item: Any) -> None:
            if isinstance(item, h5py.Dataset):
                whole = {"compression": "gzip", "chunks": item.shape} if item.shape else {}
                kept = packed.create_dataset(name, data=item[()], dtype=item.dtype, **whole)
            else:
                kept = packed.require_group(name)
            kept.attrs.update(item.attrs)

        packed.attrs.update(source.attrs)
        source.visititems(copy)


def _buffer(number: int, episode: Played, agent: int) -> Any:
    """Return an episode as Minari takes it; `agent` is the number of who acted."""
    from minari.data_collector import EpisodeBuffer

    infos = {name: np.array(values) for name, values in episode.infos.items()}
    return EpisodeBuffer(
        id=number,
        seed=episode.seed,
        observations=_columns(episode.observations),
        actions=np.array(episode.actions, dtype=np.int64),
        rewards=np.array(episode.rewards),
        terminations=_last(len(episode.actions), episode.terminated),
        truncations=_last(len(episode.actions), not episode.terminated),
        infos=infos | {"agent": np.full(len(episode.observations), agent)},
    )


def _columns(observations: Sequence[Any]) -> Any:
    """Return observations (n_steps + 1, ...), by name where they are dictionaries."""
    if isinstance(observations[0], dict):
        return {name: np.stack([one[name] for one in observations]) for name in observations[0]}
    return np.stack(observations)


def _last(n_steps: int, at_the_end: bool) -> npt.NDArray[np.bool_]:
    """Return flags (n_steps,), all false but the last, which is `at_the_end`."""
    flags = np.zeros(n_steps, dtype=bool)
    flags[-1] = at_the_end
    return flags


def size_bytes(folder: Path) -> int:
    """Return how large the files in `folder` are together."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
