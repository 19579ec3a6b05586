"""usbench: ultrasound guidance tasks for reinforcement learning, and a comparison of algorithms on them."""

from gymnasium.envs.registration import register, registry

from usbench.tasks import BUILT_IN

__version__ = "0.1.0"

for _row in BUILT_IN.values():
    if _row.env_id not in registry:
        register(id=_row.env_id, entry_point=_row.entry_point, max_episode_steps=_row.n_steps)
