"""Figures of pages that show frames: their labels say what each frame is and what its axes are."""

import anatomy
import imaging_setup
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg

from usbench.envs.pose import Pose
from usbench.envs.tasks.imaging_setup import IMAGING_SETUP


class Grey:
    """Frames that are grey everywhere."""

    def frame(self, pose):
        return np.full((90, 40), 128, np.uint8)


def fit_beside_each_other(figure):
    """Say whether no title reaches into the next one, or out of the figure."""
    FigureCanvasAgg(figure).draw()
    titles = [axis.title.get_window_extent() for axis in figure.axes if axis.get_title()]
    apart = not any(one.overlaps(other) for one in titles for other in titles if one is not other)
    return apart and all(one.x0 >= 0 and one.x1 <= figure.bbox.width for one in titles)


def test_frames_of_settings_say_their_setting_and_which_ratio_they_have():
    quality = {pose: (1.29, 0.79, -0.9) for pose in IMAGING_SETUP.states}
    figure = imaging_setup.figure(Grey(), quality, imaging_setup.best_of(quality))
    frames = [axis for axis in figure.axes if axis.images]
    assert frames[0].get_title() == "focal depth 30 mm\ncontrast-to-noise ratio 1.29"
    assert {axis.get_xlabel() for axis in frames} == {"lateral (mm)"}
    assert [axis.get_ylabel() for axis in frames] == ["depth (mm)", "", ""] * 3
    curves = [axis for axis in figure.axes if axis.lines]
    words = [text.get_text() for text in curves[0].get_legend().get_texts()]
    assert words == ["contrast-to-noise ratio", "generalized contrast-to-noise ratio"]
    assert all(axis.get_ylabel() for axis in curves)
    assert fit_beside_each_other(figure)


def test_frames_of_an_anatomy_say_their_kind_and_pose(monkeypatch):
    monkeypatch.setattr(anatomy, "frame_store", lambda *_: Grey())
    figure = anatomy.draw(dict.fromkeys(("recorded", "simulated")), [Pose(-10, 20, 0), Pose(-10, 20, 150)])
    assert [axis.get_title() for axis in figure.axes] == [
        f"{kind}\nx -10 mm, {angle}°" for kind in ("recorded", "simulated") for angle in (0, 150)
    ]
    assert {axis.get_xlabel() for axis in figure.axes} == {"lateral (mm)"}
    assert [axis.get_ylabel() for axis in figure.axes] == ["depth (mm)", ""] * 2
    assert fit_beside_each_other(figure)
