"""A trial that Weights & Biases follows: all that TensorBoard gets, and the configuration."""

import contextlib
from collections.abc import Iterator
from dataclasses import asdict
from importlib.util import find_spec

from usbench.checks import install
from usbench.records import ConfigurationError, TrialConfig
from usbench.words import in_one_line

PROJECT = "usbench"


def check_installed() -> None:
    """Refuse to follow a trial where Weights & Biases is not installed.

    Raises:
        ConfigurationError: If it is not.
    """
    # Looked for and not imported, which takes seconds. A folder of that name, as W&B leaves, has no origin.
    spec = find_spec("wandb")
    if spec is None or spec.origin is None:
        raise ConfigurationError(
            f"Weights & Biases, which is to follow the trial, is not installed: {install('wandb')}."
        )


@contextlib.contextmanager
def followed(config: TrialConfig) -> Iterator[None]:
    """Let Weights & Biases follow the trial that runs inside; its own variables say how (WANDB_MODE, ..).

    Raises:
        ConfigurationError: If it is not installed or lets no run begin, as without an account.
    """
    check_installed()
    import wandb

    try:
        run = wandb.init(
            project=PROJECT,
            name=config.folder_name,
            group=f"{config.task}-p{config.noise:g}-{config.algo}",
            config=asdict(config),
            # Before the trial makes its TensorBoard writer, which is what it listens to.
            sync_tensorboard=True,
            settings=wandb.Settings(console="off"),
        )
    except wandb.Error as error:
        raise ConfigurationError(
            f"Weights & Biases lets no run begin ({in_one_line(error)}): run 'wandb login', or set "
            "WANDB_MODE=offline."
        ) from error
    try:
        yield
    except BaseException:
        run.finish(exit_code=1)
        raise
    run.finish()
