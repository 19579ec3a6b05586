"""The network of every algorithm here, as PyTorch's own layers one after the other."""

import torch
from torch import nn
from torch.nn import functional


def trunk(n_channels: int, norm: type[nn.BatchNorm2d] = nn.BatchNorm2d) -> nn.Sequential:
    """Two blocks of convolution, batch norm, ReLU, max-pool: 32 * (height // 4) * (width // 4) outputs."""
    return nn.Sequential(
        nn.Conv2d(n_channels, 16, 3, padding=1, bias=False),
        norm(16),
        nn.ReLU(),
        nn.MaxPool2d(2),
        nn.Conv2d(16, 32, 3, padding=1, bias=False),
        norm(32),
        nn.ReLU(),
        nn.MaxPool2d(2),
        nn.Flatten(),
    )


class RunningNorm(nn.BatchNorm2d):
    """Batch norm that learns with its running statistics, moved by an update's first batch for the next."""

    held: tuple[torch.Tensor, torch.Tensor] | None = None

    def train(self, mode: bool = True) -> "RunningNorm":
        """Begins or ends an update."""
        self.held = None
        return super().train(mode)

    def forward(self, maps: torch.Tensor) -> torch.Tensor:
        """`maps` (n, channels, height, width), normalised."""
        if self.training and torch.is_grad_enabled() and self.held is None:
            self.held = self.running_mean.clone(), self.running_var.clone()
            with torch.no_grad():
                self.num_batches_tracked += 1
                share = max(self.momentum, 1 / int(self.num_batches_tracked))
                self.running_mean.lerp_(maps.mean((0, 2, 3)), share)
                self.running_var.lerp_(maps.var((0, 2, 3), correction=0), share)
        mean, var = self.held or (self.running_mean, self.running_var)
        return functional.batch_norm(maps, mean, var, self.weight, self.bias, eps=self.eps)
