"""What a row of the table of algorithms is, and the networks that rows share."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from usbench.agents.hyperparameters import Value
from usbench.checks import unknown

# What an agent may need beside the environment: functions of `usbench.trials.knowledge`.
NEEDS = ("teacher", "scene_model")


@dataclass(frozen=True)
class Entry:
    """A row of the table. Texts "module:name" stand for what is imported when a model is made.

    Raises:
        ValueError: `needs` names nothing that a task gives.
    """

    cls: str
    policy: str | None = None
    hyperparameters: Mapping[str, Value] = field(default_factory=dict)
    # What can be set besides. At these values, which are those of the class, a trial does not record them: so
    # what a row learns to do later leaves the trials before as they are.
    options: Mapping[str, Value] = field(default_factory=dict)
    policy_kwargs: Mapping[str, Any] = field(default_factory=dict)
    kwargs: Mapping[str, Any] = field(default_factory=dict)
    # What `kwargs` hold besides where observations are dictionaries of an image and senses.
    kwargs_with_senses: Mapping[str, Any] = field(default_factory=dict)
    tasks: Mapping[str, Mapping[str, Value]] = field(default_factory=dict)
    presets: Mapping[str, Mapping[str, Value]] = field(default_factory=dict)
    # How many environments in step it learns in, unless a trial says otherwise.
    n_envs: int = 1
    learns: bool = True
    # What it is given of its task beside the environment, one of `NEEDS`. An agent with a need learns from
    # knowledge of the simulator; those of `usbench.ceilings.TAUGHT` are not ranked.
    needs: str = ""
    # Whether the agent looks at frames; for an agent that does not look, no frames are simulated.
    looks: bool = True
    # Whether it is a row of the paper's grid and of the search; others are made for unseen phantoms.
    compared: bool = True
    # What it is, in a line.
    title: str = ""

    def __post_init__(self) -> None:
        """Check that a task gives what is needed."""
        if self.needs and self.needs not in NEEDS:
            raise unknown("need of an algorithm", self.needs, NEEDS)


# Every network is a trunk and one fully connected output.
TRUNK = {"features_extractor_class": "usbench.agents.networks:ConvTrunk", "net_arch": []}
# Separate trunks, as in VPG: errors of values are tens in size and would drown the policy in a shared trunk.
SEPARATE = {**TRUNK, "share_features_extractor": False}
# For losses that compare with what the network said while it acted, or with a target network: see `Block`.
RUNNING = {"features_extractor_kwargs": {"batch_statistics": False}}
REPLAY = {"replay_buffer_class": "usbench.agents.frame_buffer:FrameReplayBuffer"}
