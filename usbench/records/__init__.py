"""What a trial leaves behind: one folder, written so that a crash loses nothing, and read back.

Nothing here imports torch.
"""

from usbench.checks import ConfigurationError
from usbench.records.configuration import (
    MAX_FRAMES,
    VOLUME,
    TrialConfig,
    identity,
)
from usbench.records.episode import Episode, Evaluation
from usbench.records.folder import (
    CHECKPOINTS,
    EPISODES,
    EVALUATIONS,
    LEARNING_CURVE,
    MODEL,
    REPLAY,
    TENSORBOARD,
    TRIAL,
    WEIGHTS,
    check_writable,
    create,
    existing,
    model_in,
    no_trial,
    trial_folders,
    unwritable,
    without_record,
)
from usbench.records.loading import load, load_trials
from usbench.records.trial import (
    DIVERGED,
    EXPLORATION,
    Frames,
    Trial,
    TrialError,
    means,
)

__all__ = [
    "CHECKPOINTS",
    "DIVERGED",
    "EPISODES",
    "EVALUATIONS",
    "EXPLORATION",
    "LEARNING_CURVE",
    "MAX_FRAMES",
    "MODEL",
    "REPLAY",
    "TENSORBOARD",
    "TRIAL",
    "VOLUME",
    "WEIGHTS",
    "ConfigurationError",
    "Episode",
    "Evaluation",
    "Frames",
    "Trial",
    "TrialError",
    "TrialConfig",
    "check_writable",
    "create",
    "existing",
    "identity",
    "load",
    "load_trials",
    "means",
    "model_in",
    "no_trial",
    "trial_folders",
    "unwritable",
    "without_record",
]
