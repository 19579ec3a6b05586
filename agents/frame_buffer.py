"""A replay buffer for image stacks that keeps every different frame once: some MB instead of GB."""

import hashlib
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from gymnasium import spaces
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.type_aliases import ReplayBufferSamples
from stable_baselines3.common.vec_env import VecNormalize

from usbench.agents.networks import IMAGE, SENSES

TRANSITIONS = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")


class FrameReplayBuffer(ReplayBuffer):
    """SB3's replay buffer of `(height, width, channels)` observations, stored as the numbers of their frames.

    A stack of four float32 frames of 90 x 40 pixels takes 57.6 kB, and each transition has two of them,
    although a fixed phantom shows only a few hundred frames in all. Here a transition holds eight numbers.
    Of observations with senses, dictionaries of `image` and `senses`, the senses have a number too.
    Sampled observations have the same bits as those that were added. Frames that no transition has any more
    are dropped, each time the buffer has been filled anew.
    """

    def __init__(
        self,
        buffer_size: int,
        observation_space: spaces.Box | spaces.Dict,
        action_space: spaces.Space[Any],
        device: torch.device | str = "auto",
        n_envs: int = 1,
        **kwargs: Any,
    ) -> None:
        """Takes SB3's arguments.

        Raises:
            ValueError: `optimize_memory_usage` is True, which would save nothing here.
        """
        if kwargs.get("optimize_memory_usage"):
            raise ValueError(
                f"optimize_memory_usage must be False with a {type(self).__name__}, which keeps every frame "
                "once anyway."
            )
        parts: dict[str, Any] = {IMAGE: observation_space}
        if isinstance(observation_space, spaces.Dict):
            parts = observation_space.spaces
        image, senses = parts[IMAGE], parts.get(SENSES)
        channels = image.shape[-1]
        self._frames = self._store(image)
        self._senses = None if senses is None else Distinct(senses.shape, senses.dtype)
        n_numbers = channels + (self._senses is not None)
        numbers = spaces.Box(0, np.iinfo(np.int32).max, (n_numbers,), np.int32)
        super().__init__(buffer_size, numbers, action_space, device, n_envs, **kwargs)

    def add(
        self,
        obs: Any,
        next_obs: Any,
        action: npt.NDArray[Any],
        reward: npt.NDArray[Any],
        done: npt.NDArray[Any],
        infos: list[dict[str, Any]],
    ) -> None:
        """Adds a transition of each environment, as SB3 does."""
        super().add(self._numbered(obs), self._numbered(next_obs), action, reward, done, infos)
        if self.pos == 0:
            self._drop_unused()

    def state(self) -> dict[str, Any]:
        """The contents of the buffer: views of each array's filled part, and every different frame once."""
        arrays = {name: getattr(self, name)[: self.size()] for name in TRANSITIONS}
        told = {} if self._senses is None else {"senses": self._senses.arrays}
        return {"pos": self.pos, "full": self.full, "frames": self._frames.arrays, **told, **arrays}

    def put_back(self, state: dict[str, Any]) -> None:
        """Fills the new, empty buffer with what `state` gave.

        Raises:
            ValueError: `state` comes from a larger buffer, or from a full one of another size.
        """
        n_kept = len(state["rewards"])
        if n_kept > self.buffer_size or (state["full"] and n_kept < self.buffer_size):
            raise ValueError(
                f"the state must fit a buffer of {self.buffer_size} steps, not be one of {n_kept} steps."
            )
        self.pos, self.full = state["pos"], state["full"]
        for frame in state["frames"]:
            self._frames.number(frame)
        if self._senses is not None:
            for senses in state["senses"]:
                self._senses.number(senses)
        for name in TRANSITIONS:
            getattr(self, name)[: self.size()] = state[name]

    def _drop_unused(self) -> None:
        """Drops the frames and senses that no transition has any more; the others get new numbers."""
        stores = [(self._frames, slice(None) if self._senses is None else slice(None, -1))]
        if self._senses is not None:
            stores.append((self._senses, slice(-1, None)))
        both = self.observations, self.next_observations
        for store, columns in stores:
            used = np.unique([numbers[..., columns] for numbers in both])
            store.keep(used)
            for numbers in both:
                numbers[..., columns] = np.searchsorted(used, numbers[..., columns])

    def _get_samples(
        self, batch_inds: npt.NDArray[np.intp], env: VecNormalize | None = None
    ) -> ReplayBufferSamples:
        if env is not None and env.norm_obs:
            raise ValueError(
                "a FrameReplayBuffer takes no VecNormalize that changes observations (norm_obs=True): "
                "NormalizeImage does that."
            )
        samples = super()._get_samples(batch_inds, env)
        observations = self._observations(samples.observations)
        return samples._replace(
            observations=observations, next_observations=self._observations(samples.next_observations)
        )

    def _store(self, image: spaces.Box) -> "Distinct":
        """What keeps the frames of image stacks of this space."""
        return Distinct(image.shape[:2], image.dtype)

    def _numbered(self, observations: Any) -> npt.NDArray[np.int32]:
        """The numbers of the frames `(n, channels)`; those of senses, if any, are one more column."""
        stacks = observations if self._senses is None else observations[IMAGE]
        numbers = [[self._frames.number(frame) for frame in stack] for stack in np.moveaxis(stacks, -1, 1)]
        if self._senses is not None:
            for row, senses in zip(numbers, observations[SENSES], strict=True):
                row.append(self._senses.number(senses))
        return np.array(numbers, np.int32)

    def _observations(self, numbers: torch.Tensor) -> Any:
        """The observations whose frames and senses have these numbers `(n, channels)`."""
        known = numbers.cpu().numpy()
        if self._senses is None:
            return self._stacked(known)
        senses = torch.as_tensor(self._senses.arrays[known[:, -1]], device=self.device)
        return {IMAGE: self._stacked(known[:, :-1]), SENSES: senses}

    def _stacked(self, numbers: npt.NDArray[np.int32]) -> torch.Tensor:
        """The stacks `(n, height, width, channels)` of the frames with these numbers `(n, channels)`."""
        return torch.as_tensor(np.moveaxis(self._frames.arrays[numbers], 1, -1), device=self.device)


class Distinct:
    """Different arrays of one shape, each kept once and known by its number."""

    def __init__(self, shape: tuple[int, ...], dtype: npt.DTypeLike) -> None:
        """None is known yet."""
        self._numbers: dict[bytes, int] = {}
        self._room = np.empty((256, *shape), dtype)

    @property
    def arrays(self) -> npt.NDArray[Any]:
        """All of them, `(n, *shape)`, by their numbers."""
        return self._room[: len(self._numbers)]

    def keep(self, numbers: npt.NDArray[Any]) -> None:
        """Keeps those with these sorted `numbers` `(n,)` alone, whose new numbers are 0 to n - 1."""
        keys = list(self._numbers)  # in the order of their numbers
        self._numbers = {keys[old]: new for new, old in enumerate(numbers)}
        self._room = self._room[numbers]

    def number(self, array: npt.NDArray[Any]) -> int:
        """The number of an array, a new one where it is not known yet."""
        # The array itself, as a key, would be kept twice.
        key = hashlib.blake2b(array.tobytes(), digest_size=16).digest()
        if key not in self._numbers:
            number = self._numbers[key] = len(self._numbers)
            if number == len(self._room):
                self._room = np.concatenate([self._room, np.empty_like(self._room)])
            self._room[number] = array
        return self._numbers[key]
