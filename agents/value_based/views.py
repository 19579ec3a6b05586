"""Symmetric views of batches: what observations and actions become by the symmetries of a task."""

from typing import Any

import torch
from gymnasium import spaces
from torch import nn

from usbench.agents.networks import IMAGE, SENSES, ImageLayout


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
    firsts: torch.Tensor

    def __init__(self, symmetries: Any) -> None:
        """Holds the arrays beside the weights; they are no part of a saved model."""
        super().__init__()
        for name in ("mirrored", "sources", "signs", "actions", "coordinates"):
            self.register_buffer(name, torch.as_tensor(getattr(symmetries, name)), persistent=False)
        self.register_buffer("firsts", self._firsts(), persistent=False)
        # The depth of the focus is a coordinate, too, but the same in all views.
        differs = (self.signs != self.signs[:1]).any(0) | (self.sources != self.sources[:1]).any(0)
        self._told_where = bool((self.coordinates & differs).any())

    def drawn(self, n: int) -> torch.Tensor:
        """The numbers of `n` views (n,), each as probable, drawn from PyTorch's seeded generator."""
        return torch.randint(len(self.mirrored), (n,), device=self.mirrored.device)

    def canonical(self, observations: Any) -> torch.Tensor:
        """The numbers (n,) of the views that stand for all views of the observations.

        They are those in which x, sine and cosine of the probe's angle, at the last frame, are not negative.
        An agent that is told none of them knows a scene by what it did and by its picture: the last move of
        each kind is then the first of its two actions, and the left half of the last frame is the brighter
        one. Where nothing tells two views apart, it is the first of them, as at x = 0 of an agent that is
        told coordinates: its picture and its actions are not asked.
        """
        if self._told_where:
            last = observations[SENSES][:, -self.sources.shape[1] :]
            # Views differ in the signs of coordinates: where all are positive, their sum is largest.
            score = (last[:, self.sources] * self.signs * self.coordinates).sum(-1)
        else:
            score = self._told_by_picture(observations) + self._told_by_actions(observations)
        numbers: torch.Tensor = score.argmax(1)
        return numbers

    def _told_by_actions(self, observations: Any) -> torch.Tensor:
        """How far the last moves are the first of two in each view (n, n_views); later ones count more."""
        if not isinstance(observations, dict):
            return torch.zeros(len(observations), 1, device=observations.device)
        senses = observations[SENSES]
        each = senses.view(len(senses), -1, self.sources.shape[1])
        later = 2.0 ** torch.arange(each.shape[1], device=senses.device)
        points: torch.Tensor = ((each[:, :, self.sources] * self.firsts).sum(-1) * later[:, None]).sum(1)
        return points

    def _told_by_picture(self, observations: Any) -> torch.Tensor:
        """Half a point where the left half of the last frame is the brighter in a view (n, n_views)."""
        images = observations[IMAGE] if isinstance(observations, dict) else observations
        last = images[..., -1]
        brighter = torch.sign((last - last.flip(2))[:, :, : last.shape[2] // 2].sum((1, 2)))
        return torch.where(self.mirrored, -0.5, 0.5) * brighter[:, None]

    def _firsts(self) -> torch.Tensor:
        """1 where a sense says that the last action was the first of two that views swap, -1 the second."""
        first, last = self.actions.min(0).values, self.actions.max(0).values
        number = torch.arange(len(first), device=first.device)
        says = (number < last).float() - (number > first).float()
        told = ~self.coordinates
        firsts = torch.zeros(len(told), device=first.device)
        if told.any():
            firsts[told] = says
        return firsts

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


def check_layout(space: spaces.Space[Any]) -> None:
    """Raises ValueError unless the images of a space have their channels last, as views and shifts need."""
    image = space[IMAGE] if isinstance(space, spaces.Dict) else space
    assert isinstance(image, spaces.Box)
    if ImageLayout.of(image, smallest=1).channels_first:
        raise ValueError(
            "symmetries and shifts need images (height, width, channels), not those that Stable-Baselines3 "
            "transposes: wrap the environment in NormalizeImage."
        )


def shifted(images: torch.Tensor, largest_px: int) -> torch.Tensor:
    """Images `(n, height, width, channels)`, each moved sideways by up to `largest_px` pixels.

    The edge is repeated. The shifts come from PyTorch's seeded generator. Source: Kostrikov et al., "Image
    augmentation is all you need" (2021), in one direction: the depth of a pixel is known.
    """
    shifts = torch.randint(-largest_px, largest_px + 1, (len(images), 1), device=images.device)
    return moved(images, shifts)


def moved(images: torch.Tensor, shifts: torch.Tensor) -> torch.Tensor:
    """Images `(n, height, width, channels)`, moved to the left by `shifts` pixels `(n, 1)`; edges repeat."""
    width = images.shape[2]
    columns = (torch.arange(width, device=images.device) + shifts).clamp(0, width - 1)
    return images.gather(2, columns[:, None, :, None].expand_as(images))
