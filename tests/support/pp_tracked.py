"""The task pp-tracked with all that an agent can be told: its symmetries, and random observations."""

import torch

from usbench.setting import Setting
from usbench.trials import knowledge

SETTING = Setting(task="pp-tracked", senses=("position", "heading", "actions"), n_frames=2)
SYMMETRIES = knowledge.symmetries(SETTING)


def observations(n=40, seed=0):
    generator = torch.Generator().manual_seed(seed)
    images = torch.randn(n, 90, 40, 2, generator=generator)
    senses = torch.randn(n, 2 * SYMMETRIES.sources.shape[1], generator=generator)
    return {"image": images, "senses": senses}
