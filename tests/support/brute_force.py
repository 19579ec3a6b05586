"""The value of a pose without a table, for the tests of the dynamic programme."""

from usbench.envs.pose import Pose

TARGET = Pose(0, 50, 0)


def expectimax(task, pose, steps, noise, choose):
    """Return the value of `pose` by recursion over every action and displacement, without a table."""
    if steps == 0:
        return 0.0
    values = []
    for action in task.actions:
        arrived = pose.moved(action.move, task.limits)
        value = task.reward(arrived, TARGET, "normalized")
        if noise < 1:
            value += (1 - noise) * expectimax(task, arrived, steps - 1, noise, choose)
        if noise > 0:
            for displacement in task.displacements:
                slipped = arrived.moved(displacement, task.limits)
                weight = noise / len(task.displacements)
                value += weight * expectimax(task, slipped, steps - 1, noise, choose)
        values.append(value)
    return choose(values)
