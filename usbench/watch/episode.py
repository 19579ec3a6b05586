"""What a replay and a guide say of an episode: the return of the optimum in it, and slips in words."""

from collections.abc import Mapping
from typing import Any

from usbench.coordinates import BY_NAME
from usbench.setting import Setting


def optimum(setting: Setting, seed: int, options: Mapping[str, int] | None = None) -> tuple[float, ...]:
    """Return the return of the best policy that knows the pose, after 0, 1, .. steps to the task's last.

    Args:
        setting: Task, noise and what is examined.
        seed: Seed of the episode, from which its start and its slips follow.
        options: Start pose, as `reset` takes it; by default it follows from the seed.
    """
    env: Any = setting.make_env()
    env.unwrapped.is_watched = False  # who knows the pose needs no frames
    _, info = env.reset(seed=seed, options=None if options is None else dict(options))
    plan = setting.plan(env.unwrapped.target)
    returns, over = [0.0], False
    while not over:
        pose = plan.task.pose(info)
        _, reward, stopped, truncated, info = env.step(plan.action(len(returns) - 1, pose))
        returns.append(returns[-1] + float(reward))
        over = stopped or truncated
    env.close()
    return (*returns, *[returns[-1]] * (plan.task.n_steps + 1 - len(returns)))


def slip(displaced: Mapping[str, Any]) -> str:
    """Return in words by how much noise has changed each coordinate, `info["noise"]`; empty if by nothing."""
    return ", ".join(BY_NAME[name].change_in_words(change) for name, change in displaced.items() if change)
