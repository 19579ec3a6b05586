"""A replay buffer with n-step returns for images, with or without senses, a byte per pixel."""

from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from gymnasium import spaces
from stable_baselines3.common.buffers import NStepReplayBuffer

from usbench.agents.frame_buffer import Distinct, FrameReplayBuffer

GREY_LEVELS = 256


class NStepFrameBuffer(FrameReplayBuffer, NStepReplayBuffer):
    """SB3's `NStepReplayBuffer`, which takes no dictionaries, of frames that are kept once, as bytes.

    A return sums up to `n_steps` rewards and ends with its episode; at a truncated end the value of the last
    observation counts. New phantoms show new frames all the time: as float32 those of 100 000 steps would
    take 1.4 GB. Sampled observations have the same bits as those that were added: frames that a byte per
    pixel does not tell to the bit are kept as they are, see `GreyFrames`.
    """

    _frames: "GreyFrames"

    def state(self) -> dict[str, Any]:
        """As that of `FrameReplayBuffer`; frames are grey levels, and `levels` are their values."""
        return {**super().state(), "levels": self._frames.levels}

    def put_back(self, state: dict[str, Any]) -> None:
        """Fills the new, empty buffer with what `state` gave."""
        frames = state["frames"]
        if state["levels"] is None:
            self._frames.keep_values()
        else:
            levels = self._frames.levels = np.array(state["levels"])
            # One by one: together they take four times the memory of their bytes.
            frames = (levels[codes] for codes in frames)
        super().put_back({**state, "frames": frames})

    def _store(self, image: spaces.Box) -> "GreyFrames":
        return GreyFrames(image)

    def _stacked(self, numbers: npt.NDArray[np.int32]) -> torch.Tensor:
        kept = np.moveaxis(self._frames.arrays[numbers], 1, -1)
        return torch.as_tensor(self._frames.values(kept), device=self.device)


class GreyFrames(Distinct):
    """Different frames, each kept once and known by its number: as bytes while they are grey levels.

    Grey levels are evenly spaced float32 numbers between finite bounds, each with bits of its own. In a space
    of another type or without bounds no frame is kept as bytes.

    Attributes:
        levels: The value of each grey level, (256,), NaN where no frame has it yet; None where frames are
            kept as they are, which is once there was a frame of other values.
    """

    levels: npt.NDArray[np.float32] | None

    def __init__(self, space: spaces.Box) -> None:
        """None is known yet; the bounds of `space` are the values of the grey levels 0 and 255."""
        super().__init__(space.shape[:2], np.uint8)
        self._low = float(space.low.min())
        self._step = (float(space.high.max()) - self._low) / (GREY_LEVELS - 1)
        self._dtype = space.dtype
        self.levels = np.full(GREY_LEVELS, np.nan, np.float32)
        if space.dtype != np.float32 or not 0 < self._step < np.inf:
            self.keep_values()

    def number(self, array: npt.NDArray[Any]) -> int:
        """The number of a frame `(height, width)`, a new one where it is not known yet."""
        codes = None if self.levels is None else self._codes(array, self.levels)
        if codes is None and self.levels is not None:
            self.keep_values()
        return super().number(array if codes is None else codes)

    def keep_values(self) -> None:
        """Keep frames as they are from now on, those that are known too."""
        known, self.levels = self.values(self.arrays), None
        self._numbers, self._room = {}, np.empty(self._room.shape, self._dtype)
        for frame in known:
            super().number(frame)

    def values(self, kept: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """The values of frames as they are kept, of any shape."""
        return kept if self.levels is None else self.levels[kept]

    def _codes(
        self, frame: npt.NDArray[Any], levels: npt.NDArray[np.float32]
    ) -> npt.NDArray[np.uint8] | None:
        """The grey levels of a frame, whose values are noted in `levels`; None where it has other values."""
        codes = np.rint((frame - self._low) / self._step).clip(0, GREY_LEVELS - 1).astype(np.uint8)
        known = levels[codes]
        # By their bits: 0 and -0 are equal as numbers.
        if known.tobytes() != frame.tobytes():
            levels[codes] = np.where(np.isnan(known), frame, known)
            if levels[codes].tobytes() != frame.tobytes():
                return None
        return codes
