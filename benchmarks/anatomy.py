"""Look around in a custom anatomy: what the probe sees of the volume, sliced and simulated, pose by pose.

The arguments after the file are those of `usbench run --phantom`, of the recording and of the simulation.
"""

import argparse
from pathlib import Path

from matplotlib.figure import Figure

from usbench.cli.phantom import custom_anatomy
from usbench.envs.anatomy import Anatomy
from usbench.envs.bmode import DEFAULT_IMAGING
from usbench.envs.frames import frame_store
from usbench.envs.pose import Pose
from usbench.envs.probe import DEFAULT_ARRAY
from usbench.figures import style

HALF_MM = 1e3 * DEFAULT_IMAGING.width / 2
EXTENT = (-HALF_MM, HALF_MM, 1e3 * DEFAULT_IMAGING.depth, 0)


def draw(rows: dict[str, Anatomy], poses: list[Pose]) -> Figure:
    """Draw the frames of every anatomy, a row each, from the poses, a column each."""
    figure, axes = style.panels(len(rows), len(poses), width=1.25, height=2.6)
    for panels, (name, anatomy) in zip(axes, rows.items(), strict=True):
        store = frame_store(anatomy, DEFAULT_ARRAY, DEFAULT_IMAGING)
        for axis, pose in zip(panels, poses, strict=True):
            axis.imshow(store.frame(pose), cmap="gray", vmin=0, vmax=255, extent=EXTENT)
            axis.grid(False)
            axis.set_title(f"{name}\nx {pose.x_mm} mm, {pose.angle_deg}°", fontsize=8)
            axis.set_xlabel("lateral (mm)", fontsize=8)
            axis.tick_params(labelsize=7)
            if axis is panels[0]:
                axis.set_ylabel("depth (mm)", fontsize=8)
            else:
                axis.set_yticklabels([])
    return figure


def main() -> None:
    """Draw the figure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("phantom", nargs="+", metavar="FILE NAME=VALUE", help="as for usbench run --phantom")
    parser.add_argument("--angles", nargs="+", type=int, default=[0, 30, 60, 90], metavar="DEG")
    parser.add_argument("--x", nargs="+", type=int, default=[0], metavar="MM")
    parser.add_argument("--depth", type=int, default=50, metavar="MM", help="depth of the focus (default 50)")
    parser.add_argument("--figure", type=Path, required=True, help="file to draw into (PNG, SVG or PDF)")
    args = parser.parse_args()
    rows: dict[str, Anatomy] = {}
    for kind in ("recorded", "simulated"):
        simulated = ("seed=", "density_per_mm3=", "dynamic_range_db=", "attenuation_db_per_cm_mhz=")
        words = [word for word in args.phantom if kind == "simulated" or not word.startswith(simulated)]
        found = custom_anatomy([*words, f"frames={kind}"], looking=True)
        assert found is not None
        rows[kind] = found
    poses = [Pose(x, args.depth, angle) for x in args.x for angle in args.angles]
    print(style.save(draw(rows, poses), args.figure))


if __name__ == "__main__":
    main()
