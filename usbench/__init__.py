"""usbench: ultrasound guidance tasks for reinforcement learning, and a comparison of algorithms on them."""

from gymnasium.envs.registration import register, registry

__version__ = "0.1.0"

# Entry points are strings, so that importing usbench imports neither the simulator nor torch.
for _id, _entry_point, _n_steps in (
    ("usbench/FocalPoint-v0", "usbench.envs.focal_point:FocalPointEnv", 16),
    ("usbench/ProbePlane-v0", "usbench.envs.probe_plane:ProbePlaneEnv", 16),
    ("usbench/FocalPointRandom-v0", "usbench.envs.random_phantoms:FocalPointRandomEnv", 16),
    ("usbench/ProbePlaneRandom-v0", "usbench.envs.random_phantoms:ProbePlaneRandomEnv", 16),
    ("usbench/Examination-v0", "usbench.envs.examination:ExaminationEnv", 24),
    ("usbench/ExaminationStop-v0", "usbench.envs.examination:ExaminationStopEnv", 24),
):
    if _id not in registry:
        register(id=_id, entry_point=_entry_point, max_episode_steps=_n_steps)
