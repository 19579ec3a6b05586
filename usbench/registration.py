"""A task's row as Gymnasium knows it: its id with one environment, or many in step."""

from gymnasium.envs.registration import register, registry

from usbench.tasks import Row


def register_row(row: Row) -> None:
    """Register the id of a row, unless it is known already."""
    if row.env_id not in registry:
        register(
            id=row.env_id,
            entry_point=row.entry_point,
            vector_entry_point=f"usbench.envs.vector.entry:{row.entry_point.replace(':', '.')}",
            max_episode_steps=row.n_steps,
        )
