"""PPO with an asymmetric critic: the truth is for the critic alone, and only while the agent learns."""

from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt
import torch
from gymnasium import spaces
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.utils import obs_as_tensor
from stable_baselines3.common.vec_env import VecEnv

from usbench.agents.asymmetric.policy import AsymmetricPolicy
from usbench.agents.asymmetric.rollout import StateBuffer, buffer_class
from usbench.agents.asymmetric.truth import states
from usbench.agents.on_policy import PPO
from usbench.agents.value_based.views import check_layout
from usbench.agents.vec_env import infos_after


class AsymmetricPPO(PPO):
    """SB3's PPO, whose critic sees the full state that the environment's `info` tells.

    The policy sees observations, as every agent; what it learned acts without the truth. A critic of the
    state alone is cheap and learns fast. Where observations hide what decides, its values are averages over
    what the agent may have seen, which biases the gradient (Baisero and Amato 2022, Theorem 4.2).

    With `symmetric_views` the policy learns from each step in random views of the task's symmetries, as
    `StateBuffer` says.

    Sources: Pinto et al., "Asymmetric actor critic for image-based robot learning" (2017); Schulman et al.,
    "Proximal policy optimization algorithms" (2017).

    Attributes:
        takes_symmetries: Whether the class is made with the `symmetries` of a task.
    """

    takes_symmetries = True
    policy_aliases: ClassVar[dict[str, type[BasePolicy]]] = {
        name: AsymmetricPolicy for name in ("MlpPolicy", "CnnPolicy", "MultiInputPolicy")
    }
    policy: AsymmetricPolicy
    rollout_buffer: StateBuffer
    # The states of `_last_obs`, (n_envs, SIZE).
    _last_states: npt.NDArray[np.float32] | None = None

    def __init__(
        self, policy: Any, env: Any, *, symmetric_views: bool = False, symmetries: Any = None, **kwargs: Any
    ) -> None:
        """Takes SB3's arguments for `PPO`, and those below.

        Args:
            policy: As in SB3.
            env: As in SB3; its infos tell a state.
            symmetric_views: Whether steps are seen in random views while the agent learns.
            symmetries: Those of the task (`usbench.envs.observation.symmetries`), None for none.
            kwargs: As in SB3.

        Raises:
            ValueError: If images have their channels first, which views do not know.
        """
        if symmetric_views:
            of_rollout = kwargs.get("rollout_buffer_kwargs") or {}
            kwargs["rollout_buffer_kwargs"] = {**of_rollout, "symmetries": symmetries}
        super().__init__(policy, env, **kwargs)

    def _setup_model(self) -> None:
        if not isinstance(self.action_space, spaces.Discrete):
            raise ValueError(f"the actions must be Discrete, not {self.action_space}.")
        if self.rollout_buffer_class is None:
            self.rollout_buffer_class = buffer_class(isinstance(self.observation_space, spaces.Dict))
        if (self.rollout_buffer_kwargs or {}).get("symmetries") is not None:
            check_layout(self.observation_space)
        super()._setup_model()

    def _setup_learn(
        self, total_timesteps: int, callback: Any = None, reset_num_timesteps: bool = True, *more: Any
    ) -> tuple[int, BaseCallback]:
        if self._last_states is None:  # they are not saved: a loaded model begins new episodes
            self._last_obs = None
        begins = reset_num_timesteps or self._last_obs is None
        found = super()._setup_learn(total_timesteps, callback, reset_num_timesteps, *more)
        if begins:
            assert self.env is not None
            self._last_states = states(self.env.unwrapped.reset_infos)
        return found

    def collect_rollouts(
        self, env: VecEnv, callback: BaseCallback, rollout_buffer: RolloutBuffer, n_rollout_steps: int
    ) -> bool:
        """As in SB3: fills the rollout with steps; False if the callback ended it before."""
        assert isinstance(rollout_buffer, StateBuffer) and self._last_obs is not None
        assert self._last_states is not None and self._last_episode_starts is not None
        self.policy.set_training_mode(False)
        rollout_buffer.reset()
        callback.on_rollout_start()
        dones = self._last_episode_starts
        for _ in range(n_rollout_steps):
            with torch.no_grad():
                actions, no_values, log_probs = self.policy(obs_as_tensor(self._last_obs, self.device))  # type: ignore[arg-type]
            chosen = actions.cpu().numpy()
            observations, rewards, dones, infos = env.step(chosen)
            self.num_timesteps += env.num_envs
            callback.update_locals(locals())
            if not callback.on_step():
                self._last_states = None  # of this step nothing is noted: learning on begins new episodes
                return False
            self._update_info_buffer(infos, dones)
            self._value_truncated_ends(rewards, dones, infos)
            step = self._last_obs, chosen[:, None], rewards, self._last_episode_starts, no_values, log_probs
            rollout_buffer.add_step(self._last_states, *step)
            self._last_obs, self._last_episode_starts = observations, dones  # type: ignore[assignment]
            self._last_states = states(infos_after(env, dones, infos))
        rollout_buffer.compute_returns_and_advantage(self._values(self._last_states), dones)
        callback.update_locals(locals())
        callback.on_rollout_end()
        return True

    def _value_truncated_ends(
        self, rewards: npt.NDArray[np.float32], dones: npt.NDArray[np.bool_], infos: list[dict[str, Any]]
    ) -> None:
        """Adds to rewards `(n_envs,)` the value of the state in which an episode was cut off."""
        cut = [i for i, info in enumerate(infos) if dones[i] and info.get("TimeLimit.truncated", False)]
        if cut:
            values = self._values(states([infos[i] for i in cut]))
            rewards[cut] += self.gamma * values.flatten().cpu().numpy()

    def _values(self, seen: npt.NDArray[np.float32]) -> torch.Tensor:
        with torch.no_grad():
            return self.policy.values(torch.as_tensor(seen, device=self.device))

    def _excluded_save_params(self) -> list[str]:
        return [*super()._excluded_save_params(), "_last_states"]
