"""Vanilla policy gradient, the paper's algorithm, in the shape of Stable-Baselines3's own `a2c.py`."""

from typing import Any, Self

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.buffers import DictRolloutBuffer, RolloutBuffer
from stable_baselines3.common.type_aliases import GymEnv, MaybeCallback, Schedule
from stable_baselines3.common.utils import FloatSchedule, explained_variance, update_learning_rate
from torch import nn
from torch.nn import functional
from torch.optim import Adam, Optimizer

from usbench.agents.hyperparameters import check
from usbench.agents.on_policy import ValuesAtEnd, ValuesAtEndBuffer
from usbench.agents.policies import SeparatePolicy

# PyTorch's default, of which `adam_beta1` is the other half.
ADAM_BETA2 = 0.999


class RewardToGoBuffer(ValuesAtEndBuffer):
    """SB3's rollout, with GAE(lambda) advantages and discounted rewards-to-go as `returns`.

    Where an episode goes on after the rollout, the value of what follows stands for the rewards to come.
    """

    def compute_returns_and_advantage(self, last_values: torch.Tensor, dones: np.ndarray[Any, Any]) -> None:
        """Fills `advantages` (Schulman et al. 2016, Eq. 16) and `returns`, both `(n_steps, n_envs)`."""
        super().compute_returns_and_advantage(last_values, dones)
        to_go = last_values.detach().cpu().numpy().flatten()
        ends = np.vstack([self.episode_starts[1:], dones])
        for step in reversed(range(self.buffer_size)):
            to_go = self.rewards[step] + self.gamma * to_go * (1.0 - ends[step])
            self.returns[step] = to_go


class RewardToGoDictBuffer(RewardToGoBuffer, DictRolloutBuffer):
    """The same for observations that are dictionaries."""


class VPG(ValuesAtEnd):
    """Vanilla policy gradient with a value baseline, as in Spinning Up (Achiam 2018).

    Each update uses `n_steps` fresh steps per environment: one policy step on -mean(log pi(a|s) A), A the GAE
    advantages normalised over the batch, then `n_value_steps` steps on mean (V(s) - reward-to-go)^2, each on
    the whole batch. Where an episode is truncated or outlasts the rollout, V stands for the rewards to come.

    Batch norm: whatever meets the environment (sampled actions, values for advantages and bootstrapping,
    `predict`) is computed in evaluation mode, with running statistics. The two losses, and so the
    log-probabilities and values in them, are computed in training mode, with the statistics of the batch,
    which also move the running ones. These average about the last ten rollouts for the policy (momentum 0.1),
    more than one rollout's accidents and less than ten policy steps of 1e-4 change the weights.

    Initial value: where truncated episodes are bootstrapped, V has no horizon, yet it starts near 0, as if
    nothing came after an episode. Until it has found its level, over tens of updates, advantages tell how
    many steps were left, which no observation shows, rather than which action was good, and the policy
    follows them into a corner. `initial_value`, added to V's output, starts it where it belongs: at about
    r / (1 - gamma) for the reward r per step of the policy at the start.

    No momentum: the trunk's features, thousands, are all positive, so the weights of an action move together
    and the averaged sign of a few noisy gradients adds up to whole logits. With Adam's usual beta_1 of 0.9,
    policies were certain within tens of updates, of whatever came first; hence `adam_beta1=0`.

    Args:
        policy: "CnnPolicy" (two convolutional trunks), "MlpPolicy", "MultiInputPolicy" for observations that
            are dictionaries, or a class derived from `SeparatePolicy`.
        env: the environment or its Gymnasium id.
        learning_rate: Adam's step for the policy, in (0, 1], or a schedule over the progress remaining.
        value_learning_rate: the same for the value function.
        n_steps: steps per environment and update, at least 2.
        gamma: discount factor, in (0, 1].
        gae_lambda: lambda of the advantages, in [0, 1].
        n_value_steps: value steps per update, at least 1; Spinning Up takes 80.
        initial_value: what V starts from, finite.
        adam_beta1: Adam's momentum (beta_1) for both networks, in [0, 1). `optimizer_kwargs` in
            `policy_kwargs` win over it; another optimizer than Adam does not take it.
        rollout_buffer_class: the rollout's class; where None `RewardToGoBuffer`, or for observations that
            are dictionaries `RewardToGoDictBuffer`.
        rollout_buffer_kwargs: its further arguments.
        stats_window_size: episodes over which the logged means go.
        tensorboard_log: folder for TensorBoard events, or None.
        policy_kwargs: further arguments of the policy.
        verbose: 0 silent, 1 information, 2 debug.
        seed: seed of everything random in the agent.
        device: "cpu", "cuda", "auto".
        _init_setup_model: whether to build the networks at once.

    Raises:
        TypeError: a hyperparameter has the wrong type.
        ValueError: a hyperparameter is out of range.
    """

    policy: SeparatePolicy

    def __init__(
        self,
        policy: str | type[SeparatePolicy],
        env: GymEnv | str,
        learning_rate: float | Schedule = 1e-4,
        value_learning_rate: float | Schedule = 1e-3,
        n_steps: int = 64,
        gamma: float = 0.99,
        gae_lambda: float = 0.97,
        n_value_steps: int = 3,
        initial_value: float = 0.0,
        adam_beta1: float = 0.0,
        rollout_buffer_class: type[RolloutBuffer] | None = None,
        rollout_buffer_kwargs: dict[str, Any] | None = None,
        stats_window_size: int = 100,
        tensorboard_log: str | None = None,
        policy_kwargs: dict[str, Any] | None = None,
        verbose: int = 0,
        seed: int | None = None,
        device: torch.device | str = "auto",
        _init_setup_model: bool = True,
    ) -> None:
        """See the class."""
        super().__init__(
            policy,
            env,
            learning_rate=learning_rate,
            n_steps=n_steps,
            gamma=gamma,
            gae_lambda=gae_lambda,
            # The base class wants these three; there is one loss per network here, and it is not clipped.
            ent_coef=0.0,
            vf_coef=0.0,
            max_grad_norm=float("inf"),
            use_sde=False,
            sde_sample_freq=-1,
            rollout_buffer_class=rollout_buffer_class,
            rollout_buffer_kwargs=rollout_buffer_kwargs,
            stats_window_size=stats_window_size,
            tensorboard_log=tensorboard_log,
            policy_kwargs=policy_kwargs,
            verbose=verbose,
            device=device,
            seed=seed,
            _init_setup_model=False,
            supported_action_spaces=(spaces.Box, spaces.Discrete, spaces.MultiDiscrete, spaces.MultiBinary),
        )
        self.value_learning_rate = value_learning_rate
        self.n_value_steps = n_value_steps
        self.initial_value = initial_value
        self.adam_beta1 = adam_beta1
        if _init_setup_model:
            self._setup_model()

    def _setup_model(self) -> None:
        # Here and not in the constructor, so that what `load` is given is checked too.
        for name in ("n_steps", "gamma", "gae_lambda", "n_value_steps", "initial_value", "adam_beta1"):
            setattr(self, name, check(name, getattr(self, name)))
        for name in ("learning_rate", "value_learning_rate"):
            if not callable(getattr(self, name)):
                setattr(self, name, check(name, getattr(self, name)))
        if self.rollout_buffer_class is None:
            is_dict = isinstance(self.observation_space, spaces.Dict)
            self.rollout_buffer_class = RewardToGoDictBuffer if is_dict else RewardToGoBuffer
        super()._setup_model()
        if not isinstance(self.policy, SeparatePolicy):
            raise TypeError(f"policy must be derived from SeparatePolicy, not {type(self.policy).__name__}.")
        with torch.no_grad():
            self.policy.value_net.bias.add_(self.initial_value)
        self.value_lr_schedule = FloatSchedule(self.value_learning_rate)
        self.policy.optimizer = self._optimizer(self.policy.policy_parameters(), self.lr_schedule(1))
        self.policy.value_optimizer = self._optimizer(
            self.policy.value_parameters(), self.value_lr_schedule(1)
        )

    def _optimizer(self, parameters: list[nn.Parameter], learning_rate: float) -> Optimizer:
        options = {**self.policy.optimizer_kwargs, "lr": learning_rate}
        if issubclass(self.policy.optimizer_class, Adam):
            options.setdefault("betas", (self.adam_beta1, ADAM_BETA2))
        return self.policy.optimizer_class(parameters, **options)

    def train(self) -> None:
        """One update from the rollout: one policy step, then `n_value_steps` value steps."""
        # Batch norm: statistics of the batch (see the class).
        self.policy.set_training_mode(True)
        self._update_learning_rate(self.policy.optimizer)
        update_learning_rate(
            self.policy.value_optimizer, self.value_lr_schedule(self._current_progress_remaining)
        )
        explained = explained_variance(
            self.rollout_buffer.values.flatten(), self.rollout_buffer.returns.flatten()
        )

        (rollout,) = self.rollout_buffer.get(batch_size=None)
        policy_loss, entropy = self._policy_step(rollout.observations, rollout.actions, rollout.advantages)
        value_losses = [
            self._value_step(rollout.observations, rollout.returns) for _ in range(self.n_value_steps)
        ]

        self._n_updates += 1
        self.logger.record("train/n_updates", self._n_updates, exclude="tensorboard")
        self.logger.record("train/policy_loss", policy_loss)
        # As in Spinning Up: the loss before the steps.
        self.logger.record("train/value_loss", value_losses[0])
        self.logger.record("train/entropy", entropy)
        self.logger.record("train/explained_variance", explained)

    def _policy_step(
        self, observations: Any, actions: torch.Tensor, advantages: torch.Tensor
    ) -> tuple[float, float]:
        """One step on -mean(log pi(a|s) A); returns that loss and the mean entropy, both before the step."""
        if isinstance(self.action_space, spaces.Discrete):
            actions = actions.long().flatten()
        advantages = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
        distribution = self.policy.get_distribution(observations)
        log_prob = distribution.log_prob(actions)
        loss = _descend(self.policy.optimizer, -(log_prob * advantages).mean())
        entropy = distribution.entropy()
        return loss, float((-log_prob if entropy is None else entropy).mean().item())

    def _value_step(self, observations: Any, rewards_to_go: torch.Tensor) -> float:
        """One step on mean (V(s) - reward-to-go)^2; returns that loss, before the step."""
        values = self.policy.predict_values(observations).flatten()
        return _descend(self.policy.value_optimizer, functional.mse_loss(values, rewards_to_go))

    def learn(
        self,
        total_timesteps: int,
        callback: MaybeCallback = None,
        log_interval: int = 1,
        tb_log_name: str = "VPG",
        reset_num_timesteps: bool = True,
        progress_bar: bool = False,
    ) -> Self:
        """Learns for `total_timesteps` steps, rounded up to whole updates; returns itself."""
        return super().learn(
            total_timesteps=total_timesteps,
            callback=callback,
            log_interval=log_interval,
            tb_log_name=tb_log_name,
            reset_num_timesteps=reset_num_timesteps,
            progress_bar=progress_bar,
        )

    def _get_torch_save_params(self) -> tuple[list[str], list[str]]:
        return ["policy", "policy.optimizer", "policy.value_optimizer"], []


def _descend(optimizer: Optimizer, loss: torch.Tensor) -> float:
    """One step of the optimizer down the gradient; returns the loss before it."""
    optimizer.zero_grad()
    torch.autograd.backward(loss)
    optimizer.step()
    return loss.item()
