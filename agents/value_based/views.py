"""Symmetric views of batches: what observations and actions become by the symmetries of a task."""

from typing import Any

import torch
from torch import nn

IMAGE, SENSES = "image", "senses"


class Views(nn.Module):
    """The symmetries of a task, ready for batches of tensors.

    Args:
        symmetries: Arrays `mirrored` (n,), `sources` and `signs` (n, size), `actions` (n, n_actions) and
            `coordinates` (size,), as those of `usbench.envs.observation.symmetries.Symmetries`.
    """

    mirrored: torch.Tensor
    sources: torch.Tensor
    signs: torch.Tensor
    actions: torch.Tensor
    coordinates: torch.Tensor

    def __init__(self, symmetries: Any) -> None:
        """Holds the arrays beside the weights; they are no part of a saved model."""
        super().__init__()
        for name in ("mirrored", "sources", "signs", "actions", "coordinates"):
            self.register_buffer(name, torch.as_tensor(getattr(symmetries, name)), persistent=False)

    def drawn(self, n: int) -> torch.Tensor:
        """The numbers of `n` views (n,), each as probable, drawn from PyTorch's seeded generator."""
        return torch.randint(len(self.mirrored), (n,), device=self.mirrored.device)

    def canonical(self, observations: Any) -> torch.Tensor:
        """The numbers (n,) of the views in which x, sine and cosine of the probe's angle are not negative.

        They are those of the last frame. Without senses, or where nothing tells two views apart, it is the
        first of them.
        """
        if not isinstance(observations, dict):
            return torch.zeros(len(observations), dtype=torch.long, device=observations.device)
        last = observations[SENSES][:, -self.sources.shape[1] :]
        # Views differ in the signs of coordinates: where all are positive, their sum is largest.
        seen = last[:, self.sources] * self.signs * self.coordinates
        numbers: torch.Tensor = seen.sum(-1).argmax(1)
        return numbers

    def observations(self, observations: Any, numbers: torch.Tensor) -> Any:
        """Observations with image stacks `(n, height, width, channels)`, as they are in those views."""
        if not isinstance(observations, dict):
            return self._images(observations, numbers)
        senses = observations[SENSES]
        each = senses.view(len(senses), -1, self.sources.shape[1])
        sources = self.sources[numbers][:, None].expand_as(each)
        viewed = (each.gather(2, sources) * self.signs[numbers][:, None]).view_as(senses)
        return {IMAGE: self._images(observations[IMAGE], numbers), SENSES: viewed}

    def actions_in(self, actions: torch.Tensor, numbers: torch.Tensor) -> torch.Tensor:
        """What the actions `(n, 1)` become in those views."""
        return self.actions[numbers].gather(1, actions)

    def values_from(self, values: torch.Tensor, numbers: torch.Tensor) -> torch.Tensor:
        """Values `(n, n_actions)` of the actions as they are, from those of the actions in the views."""
        return values.gather(1, self.actions[numbers])

    def _images(self, images: torch.Tensor, numbers: torch.Tensor) -> torch.Tensor:
        return torch.where(self.mirrored[numbers][:, None, None, None], images.flip(2), images)


def shifted(images: torch.Tensor, largest_px: int) -> torch.Tensor:
    """Images `(n, height, width, channels)`, each moved sideways by up to `largest_px` pixels.

    The edge is repeated. The shifts come from PyTorch's seeded generator. Source: Kostrikov et al., "Image
    augmentation is all you need" (2021), in one direction: the depth of a pixel is known.
    """
    n, _, width, _ = images.shape
    shifts = torch.randint(-largest_px, largest_px + 1, (n, 1), device=images.device)
    columns = (torch.arange(width, device=images.device) + shifts).clamp(0, width - 1)
    return images.gather(2, columns[:, None, :, None].expand_as(images))
