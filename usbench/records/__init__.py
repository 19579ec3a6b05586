"""What a trial leaves behind: one folder, written so that a crash loses nothing, and read back.

Nothing here imports torch.
"""

from usbench.records.configuration import VOLUME, ConfigurationError, TrialConfig, identity
from usbench.records.episode import OF_A_PHANTOM, SETTINGS, Episode, Evaluation
from usbench.records.folder import (
    CHECKPOINTS,
    EPISODES,
    EVALUATIONS,
    MODEL,
    STATUSES,
    TENSORBOARD,
    TRIAL,
    create,
    read_state,
    trial_folders,
    unwritable,
    write_state,
)
from usbench.records.trial import load, means

__all__ = [
    "CHECKPOINTS",
    "EPISODES",
    "EVALUATIONS",
    "MODEL",
    "OF_A_PHANTOM",
    "SETTINGS",
    "STATUSES",
    "TENSORBOARD",
    "TRIAL",
    "VOLUME",
    "ConfigurationError",
    "Episode",
    "Evaluation",
    "TrialConfig",
    "create",
    "identity",
    "load",
    "means",
    "read_state",
    "trial_folders",
    "unwritable",
    "write_state",
]
