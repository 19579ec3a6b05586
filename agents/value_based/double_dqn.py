"""Double DQN with n-step returns and symmetric views of what is remembered."""

from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt
import torch
from stable_baselines3 import DQN
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.type_aliases import RolloutReturn
from stable_baselines3.common.utils import LinearSchedule
from torch.nn import functional

from usbench.agents.hyperparameters import check
from usbench.agents.networks import IMAGE
from usbench.agents.value_based.n_step_buffer import NStepFrameBuffer
from usbench.agents.value_based.symmetric_policy import SymmetricPolicy, SymmetricQNetwork
from usbench.agents.value_based.views import check_layout, shifted

CHECKED = ("learning_rate", "final_learning_rate", "gamma", "return_steps", "max_shift_px", "greedy_shift_px")


class DoubleDQN(DQN):
    """SB3's DQN, whose target values the action that the learning network, not the target, thinks best.

    Four things differ from `DQN` besides: returns sum `return_steps` rewards, what is remembered is seen in
    a random view of the task's symmetries, the learning rate falls in a line, and while many environments
    explore, each has its own coin.

    Sources: van Hasselt et al., "Deep reinforcement learning with double Q-learning" (2016), Eq. 4; Sutton
    and Barto (2018), Eq. 7.1.

    Attributes:
        takes_symmetries: Whether the class is made with the `symmetries` of a task.
    """

    takes_symmetries = True
    policy_aliases: ClassVar[dict[str, type[BasePolicy]]] = {
        name: SymmetricPolicy for name in ("MlpPolicy", "CnnPolicy", "MultiInputPolicy")
    }
    policy: SymmetricPolicy
    q_net: SymmetricQNetwork
    q_net_target: SymmetricQNetwork
    learning_rate: float

    def __init__(
        self,
        policy: str | type[SymmetricPolicy],
        env: Any,
        *,
        learning_rate: float = 1e-3,
        final_learning_rate: float = 1e-4,
        gamma: float = 0.9,
        return_steps: int = 3,
        max_shift_px: int = 0,
        greedy_shift_px: int = 0,
        symmetries: Any = None,
        policy_kwargs: dict[str, Any] | None = None,
        **kwargs: Any,
    ) -> None:
        """Takes SB3's arguments for `DQN`, and those below.

        Args:
            policy: A `SymmetricPolicy`, or any of SB3's names for policies.
            env: As in SB3.
            learning_rate: That of the first update.
            final_learning_rate: That at the end of the training.
            gamma: Discount factor.
            return_steps: How many rewards a return sums.
            max_shift_px: By how many pixels images are moved sideways at most while the agent learns.
            greedy_shift_px: By how many pixels they are moved at most for the mean of values that greedy
                actions follow from, see `SymmetricPolicy`.
            symmetries: Those of the task (`usbench.envs.observation.symmetries`), None for none.
            policy_kwargs: As in SB3.
            kwargs: As in SB3.

        Raises:
            TypeError: If one of these numbers has the wrong type.
            ValueError: If one of them is out of range, or if images have their channels in front, and there
                are symmetries or shifts.
        """
        self.final_learning_rate = final_learning_rate
        self.return_steps = return_steps
        self.max_shift_px = max_shift_px
        self.greedy_shift_px = greedy_shift_px
        if symmetries is not None:
            policy_kwargs = {**(policy_kwargs or {}), "symmetries": symmetries}
        kwargs.setdefault("replay_buffer_class", NStepFrameBuffer)
        super().__init__(
            policy, env, learning_rate=learning_rate, gamma=gamma, policy_kwargs=policy_kwargs, **kwargs
        )

    def _setup_model(self) -> None:
        # Here and not in the constructor, so that what `load` is given is checked and counts, too.
        for name in CHECKED:
            setattr(self, name, check(name, getattr(self, name)))
        given = self.policy_kwargs, self.replay_buffer_kwargs
        if self.greedy_shift_px:
            self.policy_kwargs = {**self.policy_kwargs, "greedy_shift_px": self.greedy_shift_px}
        returns = {"n_steps": self.return_steps, "gamma": self.gamma}
        self.replay_buffer_kwargs = {**returns, **self.replay_buffer_kwargs}
        super()._setup_model()
        self.policy_kwargs, self.replay_buffer_kwargs = given
        if self.max_shift_px or self.greedy_shift_px or getattr(self.policy.q_net, "views", None) is not None:
            check_layout(self.observation_space)

    def _setup_learn(self, *args: Any, **kwargs: Any) -> tuple[int, BaseCallback]:
        before = self._last_obs
        found = super()._setup_learn(*args, **kwargs)
        if self._last_obs is not before:
            self._episodes_begin()
        return found

    def _episodes_begin(self) -> None:
        """Episodes begin in all environments: the returns of what is remembered end before them."""
        buffer = self.replay_buffer
        assert buffer is not None
        if buffer.size():
            last = buffer.pos - 1
            buffer.timeouts[last] = np.maximum(buffer.timeouts[last], 1 - buffer.dones[last])

    def collect_rollouts(self, *args: Any, **kwargs: Any) -> RolloutReturn:
        """As in SB3; where a callback ends it, the next learning begins new episodes."""
        done = super().collect_rollouts(*args, **kwargs)
        if not done.continue_training:
            self._last_obs = None  # nothing is noted of the step in which it ends
        return done

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: npt.NDArray[Any] | None = None,
        deterministic: bool = False,
    ) -> tuple[npt.NDArray[Any], Any]:
        """Actions for observations; unless `deterministic`, each is random with the exploration rate."""
        actions, state = self.policy.predict(observation, state, episode_start, deterministic)
        return (actions if deterministic else self._explored(actions)), state

    def _explored(self, actions: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """The actions of any shape, each replaced by a random one with the exploration rate."""
        chosen = np.reshape(actions, -1)
        for k in np.flatnonzero(np.random.rand(len(chosen)) < self.exploration_rate):
            chosen[k] = self.action_space.sample()
        return chosen.reshape(np.shape(actions))

    def train(self, gradient_steps: int, batch_size: int = 100) -> None:
        """Make `gradient_steps` updates, each with a batch of what is remembered."""
        self.policy.set_training_mode(True)
        self._update_learning_rate(self.policy.optimizer)
        losses = [self._update(batch_size) for _ in range(gradient_steps)]
        self._n_updates += gradient_steps
        self.logger.record("train/n_updates", self._n_updates, exclude="tensorboard")
        self.logger.record("train/loss", np.mean(losses))

    def _update(self, batch_size: int) -> float:
        """Makes an update with a batch of what is remembered, and returns the loss before it."""
        assert self.replay_buffer is not None
        batch = self.replay_buffer.sample(batch_size, env=self._vec_normalize_env)
        observations, actions, following = self._viewed(
            batch.observations, batch.actions.long(), batch.next_observations
        )
        with torch.no_grad():
            best = self.q_net(following).argmax(dim=1, keepdim=True)
            values = self.q_net_target(following).gather(1, best)
            assert batch.discounts is not None
            targets = batch.rewards + (1 - batch.dones) * batch.discounts * values
        loss = functional.smooth_l1_loss(self.q_net(observations).gather(1, actions), targets)
        return self._descended(loss)

    def _descended(self, loss: torch.Tensor) -> float:
        """Makes a step of the optimizer, its gradient clipped, and returns the loss before it."""
        self.policy.optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(self.policy.parameters(), self.max_grad_norm)
        self.policy.optimizer.step()
        return float(loss.item())

    def _viewed(
        self, observations: Any, actions: torch.Tensor, following: Any
    ) -> tuple[Any, torch.Tensor, Any]:
        """A transition in a random view: observations before and after, and the action, alike."""
        views = self.policy.q_net.views
        if views is not None:
            numbers = views.drawn(len(actions))
            observations = views.observations(observations, numbers)
            following = views.observations(following, numbers)
            actions = views.actions_in(actions, numbers)
        return self._shifted(observations), actions, self._shifted(following)

    def _shifted(self, observations: Any) -> Any:
        if not self.max_shift_px:
            return observations
        if isinstance(observations, dict):
            return {**observations, IMAGE: shifted(observations[IMAGE], self.max_shift_px)}
        return shifted(observations, self.max_shift_px)

    def _setup_lr_schedule(self) -> None:
        self.lr_schedule = LinearSchedule(self.learning_rate, self.final_learning_rate, 1.0)
