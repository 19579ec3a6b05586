"""usbench: ultrasound guidance tasks for reinforcement learning, and a comparison of algorithms on them."""

from gymnasium.envs.registration import register, registry

__version__ = "0.1.0"

# Entry points are strings, so that importing usbench imports neither the simulator nor torch.
for _id, _entry_point in (
    ("usbench/FocalPoint-v0", "usbench.envs.focal_point:FocalPointEnv"),
    ("usbench/ProbePlane-v0", "usbench.envs.probe_plane:ProbePlaneEnv"),
    ("usbench/FocalPointRandom-v0", "usbench.envs.random_phantoms:FocalPointRandomEnv"),
    ("usbench/ProbePlaneRandom-v0", "usbench.envs.random_phantoms:ProbePlaneRandomEnv"),
):
    if _id not in registry:
        register(id=_id, entry_point=_entry_point, max_episode_steps=16)
