"""The trained agents that come with the package, by name: "best:pp", and "vpg:pp" for the paper's agent.

Each is the folder of a trial in small: `trial.json`, the episodes of its last evaluation, the weights as
plain arrays (`weights.npz`, which no code is needed to read) and `card.md`, its model card. `usbench watch`,
`guide` and `dataset`, and `load_agent`, take a name as they take the folder of a trial.
"""

import re
from pathlib import Path

from usbench.checks import ConfigurationError, did_you_mean

# `make release-agents` writes it.
FOLDER = Path(__file__).resolve().with_name("trained")
CARD = "card.md"
# Of an agent, right or misspelt; what a path of Windows has before its colon is followed by a slash.
_NAME = re.compile(r"[\w-]+:[\w-]*")


def folders() -> list[Path]:
    """Return the folders of all released agents, by name."""
    return sorted(path.parent for path in FOLDER.glob(f"*/{CARD}"))


def names() -> list[str]:
    """Return the names of all released agents."""
    return [name_of(folder) for folder in folders()]


def name_of(folder: Path) -> str:
    """Return the name of the released agent in `folder`, "best:pp" of "best-pp"."""
    return folder.name.replace("-", ":", 1)


def agent_in(folder: Path) -> str:
    """Return the name of the agent whose trial is in `folder`: that of the folder, unless it is released."""
    return name_of(folder) if folder.parent == FOLDER else folder.name


def folder_of(name: str) -> Path:
    """Return the folder of the released agent `name`, whether there is one or not; inverse of `name_of`."""
    return FOLDER / name.replace(":", "-", 1)


def place(path: str | Path) -> Path:
    """Return the folder of the released agent where `path` is the name of one; any other path as it is.

    Raises:
        ConfigurationError: If `path` is such a name, but there is no such agent, or what such names have
            before their colon, but no folder; the message lists all.
    """
    if str(path) in {name.partition(":")[0] for name in names()} and not Path(path).exists():
        raise ConfigurationError(
            f"there is no folder {str(path)!r}; agents that come with the package are named with their "
            f"task: {', '.join(names())}."
        )
    if _NAME.fullmatch(str(path)) is None or Path(path).exists():
        return Path(path)
    if str(path) not in names():
        raise ConfigurationError(
            f"no trained agent {str(path)!r}{did_you_mean(path, names(), cutoff=0.8)} comes with the "
            f"package: there are {', '.join(names()) or 'none'}."
        )
    return folder_of(str(path))
