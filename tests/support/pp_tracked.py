"""The task pp-tracked with all that an agent can be told: its symmetries, and random observations."""

import torch

from usbench.setting import Setting

SETTING = Setting(task="pp-tracked", senses=("position", "heading", "actions"), n_frames=2)
SYMMETRIES = SETTING.symmetries()


def observations(n=40, seed=0):
    generator = torch.Generator().manual_seed(seed)
    images = torch.randn(n, 90, 40, 2, generator=generator)
    senses = torch.randn(n, 2 * SYMMETRIES.sources.shape[1], generator=generator)
    return {"image": images, "senses": senses}
