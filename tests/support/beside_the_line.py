"""Single points beside a line: the table of responses against the slow sum, by how loud the point is.

Run as a script it prints the rows of docs/physics.md.
"""

from dataclasses import replace

import numpy as np
from echoes import correlation

from usbench.envs import rf as module
from usbench.envs.field.slow_sum import slow_rf
from usbench.envs.probe import LinearArray
from usbench.envs.rf import simulate_rf

KINDS = {
    "as the transmit": {},
    "80 mm": {"receive_focus": 80e-3},
    "dynamic": {"receive_focus": "dynamic"},
    "dynamic, f/2": {"receive_focus": "dynamic", "receive_f_number": 2.0},
}
RANGES_DB = ((0, -10), (-10, -20), (-20, -30), (-30, -40))


def single_points(receive, depths=(20e-3, 35e-3, 50e-3, 70e-3)):
    """Of points down to -45 dB: level (dB) to the axis, correlation, error of the maximum (dB), (n, 3)."""
    array, found = replace(LinearArray(), **receive), []
    few, module.FEW_PAIRS = module.FEW_PAIRS, 0
    try:
        for z in depths:
            loudest = None
            for x in np.arange(0.0, 8.1e-3, 0.5e-3):
                scene = [(x, 1e-3, z)], [1.0], array, 50e-3, [0.1e-3]
                fast, time = simulate_rf(*scene)
                slow = slow_rf(*scene, time=time)[0]
                level = np.abs(slow).max()
                loudest = level if loudest is None else loudest
                if level < loudest * 10 ** (-45 / 20):
                    break
                largest = max(np.abs(fast).max(), 1e-9 * level)
                found.append([level / loudest, correlation(fast, slow), largest / level])
    finally:
        module.FEW_PAIRS = few
    values = np.array(found)
    values[:, [0, 2]] = 20 * np.log10(values[:, [0, 2]])
    return values


def worst(values, high_db, low_db):
    """Least correlation and largest error (dB) of the points in a range of levels."""
    some = values[(values[:, 0] <= high_db + 1e-9) & (values[:, 0] > low_db)]
    return some[:, 1].min(), np.abs(some[:, 2]).max()


if __name__ == "__main__":
    for name, receive in KINDS.items():
        rows = single_points(receive)
        cells = ["{:.4f}, {:.2f} dB".format(*worst(rows, *limits)) for limits in RANGES_DB]
        print(f"| {name} | {' | '.join(cells)} |")
