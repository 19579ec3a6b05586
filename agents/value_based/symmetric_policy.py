"""A dueling Q-network that gives symmetric observations symmetric values, and its policy."""

from typing import Any

import torch
from gymnasium import spaces
from stable_baselines3.common.torch_layers import create_mlp
from stable_baselines3.dqn.policies import DQNPolicy, QNetwork
from torch import nn

from usbench.agents.networks import IMAGE
from usbench.agents.sensing_trunk import SensingTrunk
from usbench.agents.value_based.views import Views, moved


class SymmetricQNetwork(QNetwork):
    """Values of the actions: features of the observation, and one output for its value and the advantages.

    With `symmetries`, the network looks at the canonical view of an observation (see `Views.canonical`), and
    the values are turned back: told the whole pose, it learns an eighth of the poses, and gives the others
    the same values turned, but for those whose coordinates do not tell two views apart. Without `canonical`
    the network looks at observations as they are.

    Source: Wang et al., "Dueling network architectures" (2016), Eq. 9.
    """

    views: Views | None

    def __init__(self, *args: Any, symmetries: Any = None, canonical: bool = True, **kwargs: Any) -> None:
        """Takes SB3's arguments, the task's `symmetries` (None for none), and whether views are canonical."""
        super().__init__(*args, **kwargs)
        self.canonical = canonical
        n_outputs = int(self.action_space.n) + 1
        self.q_net = nn.Sequential(
            *create_mlp(self.features_dim, n_outputs, self.net_arch, self.activation_fn)
        )
        self.views = None if symmetries is None else Views(symmetries)

    def forward(self, obs: Any) -> torch.Tensor:
        """Values `(n, n_actions)` of a batch of observations."""
        if self.views is None or not self.canonical:
            return self._dueling(obs)
        numbers = self.views.canonical(obs)
        return self.views.values_from(self._dueling(self.views.observations(obs, numbers)), numbers)

    def _dueling(self, obs: Any) -> torch.Tensor:
        outputs = super().forward(obs)
        value, advantages = outputs[:, :1], outputs[:, 1:]
        return value + advantages - advantages.mean(dim=1, keepdim=True)


class SymmetricPolicy(DQNPolicy):
    """SB3's policy for DQN; its networks are of the class `SymmetricQNetwork`.

    Greedy actions are those of the target network, whose weights are an average of those of many updates.
    With `greedy_shift_px` = n they are those of the mean of its values for the picture moved sideways by
    -n to n pixels, so that details of the speckle decide less. Training is as without it.

    Source: Kostrikov et al., "Image augmentation is all you need" (2021), Section 3.2, which takes such means
    for targets.
    """

    q_net: SymmetricQNetwork
    q_net_target: SymmetricQNetwork

    def __init__(
        self,
        observation_space: spaces.Space[Any],
        *args: Any,
        symmetries: Any = None,
        canonical: bool = True,
        greedy_shift_px: int = 0,
        **kwargs: Any,
    ) -> None:
        """Takes SB3's arguments, those of `SymmetricQNetwork`, and `greedy_shift_px`.

        Observations that are dictionaries have a `SensingTrunk` by default.
        """
        self.symmetries, self.canonical = symmetries, canonical
        self.greedy_shift_px = greedy_shift_px
        if isinstance(observation_space, spaces.Dict):
            kwargs.setdefault("features_extractor_class", SensingTrunk)
        super().__init__(observation_space, *args, **kwargs)

    @property
    def greedy_net(self) -> QNetwork:
        """The network whose best action is the greedy one."""
        return self.q_net_target

    def make_q_net(self) -> QNetwork:
        """A new network."""
        arguments = self._update_features_extractor(self.net_args, features_extractor=None)
        own = {"symmetries": self.symmetries, "canonical": self.canonical}
        return SymmetricQNetwork(**arguments, **own).to(self.device)

    def _get_constructor_parameters(self) -> dict[str, Any]:
        names = ("symmetries", "canonical", "greedy_shift_px")
        return {**super()._get_constructor_parameters(), **{name: getattr(self, name) for name in names}}

    def _predict(self, obs: Any, deterministic: bool = True) -> torch.Tensor:
        values = self.greedy_values(obs) if deterministic else self.q_net(obs)
        actions: torch.Tensor = values.argmax(dim=1)
        return actions

    def greedy_values(self, obs: Any) -> torch.Tensor:
        """The values `(n, n_actions)` that greedy actions follow from."""
        shifts = range(-self.greedy_shift_px, self.greedy_shift_px + 1)
        return torch.stack([self.greedy_net(_moved(obs, shift)) for shift in shifts]).mean(dim=0)


def _moved(observations: Any, shift: int) -> Any:
    """The observations with their images moved by `shift` pixels."""
    if not shift:
        return observations
    images = observations[IMAGE] if isinstance(observations, dict) else observations
    seen = moved(images, torch.full((len(images), 1), shift, device=images.device))
    return {**observations, IMAGE: seen} if isinstance(observations, dict) else seen
