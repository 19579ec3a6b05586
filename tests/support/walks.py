"""Short walks through every version of every environment, and what was recorded of them.

`python tests/support/walks.py` prints how far the walks of this machine are from the record. `--write` adds
those of ids that are new; the others are frozen. `--table` prints the table of docs/versions.md.
"""

import argparse
import hashlib
import warnings
from importlib import metadata
from pathlib import Path

import gymnasium as gym
import llvmlite.binding
import numpy as np

from usbench import tasks

RECORD = Path(__file__).parents[1] / "reference" / "walks.npz"
# Options of the reset and actions. Some foci are short: there beams are the most complex.
WALKS = {
    "FocalPoint-v0": ({"x_mm": -20, "focal_depth_mm": 5}, (0, 2, 2, 4)),
    "ProbePlane-v0": ({}, (1, 3, 4, 2)),
    "FocalPointRandom-v0": ({}, (2, 3, 2, 0)),
    "ProbePlaneRandom-v0": ({}, (1, 3, 4, 2)),
    "Examination-v0": ({"focal_depth_mm": 10}, (2, 6, 3, 5)),
    "ExaminationStop-v0": ({"focal_depth_mm": 50}, (1, 6, 6, 7)),
    "ProbePlaneTracked-v0": ({}, (1, 3, 4, 2)),
    "ExaminationRandom-v0": ({"focal_depth_mm": 10}, (2, 6, 3, 5)),
    "ExaminationTracked-v0": ({"focal_depth_mm": 50}, (1, 6, 6, 5)),
    "ImagingSetup-v0": ({"focal_depth_mm": 50, "frequency_khz": 3000}, (6, 0, 5, 4)),
    "ImagingSetup-v1": ({"focal_depth_mm": 50, "frequency_khz": 3000}, (6, 0, 5, 4)),
}
LIBRARIES = ("numpy", "scipy", "numba", "llvmlite", "opencv-python-headless")
KINDS = ("frames", "states", "rewards", "ends", "senses")


def walk(name):
    """Return of a noisy walk: frames (n, 90, 40), states (n, n_coordinates), rewards and ends (n - 1,).

    And what the probe's senses tell, (n, n_senses).
    """
    options, actions = WALKS[name]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of Gymnasium, where there is a newer version
        env = gym.make(f"usbench/{name}", noise=0.5)
    (seen, info), coordinates = env.reset(seed=7, options=options), env.unwrapped.task.coordinates
    observations, states, rewards, ends = [seen], [[info[one] for one in coordinates]], [], []
    for action in actions:
        seen, reward, terminated, truncated, info = env.step(action)
        observations.append(seen)
        states.append([info[one] for one in coordinates])
        rewards.append(reward)
        ends.append(terminated or truncated)
    env.close()
    has_senses = isinstance(seen, dict)
    frames = np.stack([one["image"] if has_senses else one for one in observations])[..., 0]
    senses = np.array([one["senses"] if has_senses else [] for one in observations])
    return dict(zip(KINDS, (frames, states, rewards, ends, senses), strict=True))


def recorded(name):
    """Return the same as it was recorded."""
    with np.load(RECORD) as file:
        return {kind: file[f"{name}/{kind}"] for kind in KINDS}


def table():
    """Return the walks on record as the lines of a Markdown table: actions, return, digest of frames."""
    lines = [
        "| id | options of the reset | actions | return | digest of the frames |",
        "|---|---|---|---|---|",
    ]
    for name, (options, actions) in WALKS.items():
        record = recorded(name)
        digest = hashlib.sha256(record["frames"].tobytes()).hexdigest()[:16]
        places = ", ".join(f"`{key}={value}`" for key, value in options.items()) or "none"
        done = ", ".join(map(str, actions))
        lines.append(f"| `{name}` | {places} | {done} | {record['rewards'].sum():.5f} | `{digest}` |")
    return lines


def machine():
    """Return the kind of processor and the libraries with which frames have the same bits, in words."""
    libraries = (f"{name} {metadata.version(name)}" for name in LIBRARIES)
    return ", ".join((llvmlite.binding.get_host_cpu_name(), *libraries))


def was_recorded_here():
    """Return whether the record was made by such a processor with such libraries."""
    with np.load(RECORD) as file:
        return str(file["machine"]) == machine()


def ids():
    """Return the ids of this package, without its name."""
    return [row.env_id.partition("/")[2] for row in tasks.BUILT_IN.values()]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--write", action="store_true", help="add the walks that are not on record")
    parser.add_argument("--table", action="store_true", help="print the table of the page alone")
    arguments = parser.parse_args()
    if arguments.table:
        print(*table(), sep="\n")
        return
    if arguments.write:
        with np.load(RECORD) as file:
            record = dict(file)
        for name in WALKS:
            if f"{name}/{KINDS[0]}" not in record:
                record |= {f"{name}/{kind}": value for kind, value in walk(name).items()}
        np.savez_compressed(RECORD, **record)
    for name in WALKS:
        differ = walk(name)["frames"].astype(int) - recorded(name)["frames"]
        print(
            f"{name}: {np.count_nonzero(differ)} of {differ.size} pixels, by {np.abs(differ).max()} at most"
        )


if __name__ == "__main__":
    main()
