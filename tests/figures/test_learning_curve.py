"""The learning curve: drawn from records alone, the same bytes every time."""

import dataclasses

import pytest
from PIL import Image
from state_files import write_state

from usbench import records
from usbench.figures import learning_curve
from usbench.records import Episode, Evaluation, TrialConfig
from usbench.records.journal import Journal

CONFIG = TrialConfig(task="fp", algo="vpg", noise=0.0, seed=0, steps=64)
POSES = {f"{when}_{key}": 0 for when in ("start", "final") for key in ("x_mm", "focal_depth_mm", "angle_deg")}
REST = {"final_distance_mm": 1.0, "final_sin_angle": 0.0, "is_success": False, "steps_to_goal": None}


def trial(out, evaluations=True, episodes=True, explores=False):
    folder = records.create(out, CONFIG)
    anchors = {"optimal": -5.0, "random": -21.0, "stay": -22.0}
    state = {"status": "finished", "config": dataclasses.asdict(CONFIG), "anchors": anchors}
    write_state(folder, state | {"explores": explores})
    with Journal(folder / records.EPISODES) as journal:
        for number in range(4 * episodes):
            row = Episode(episode=number, step=16 * number + 16, return_=-20.0 + number, poses=POSES, **REST)
            journal.append([row.as_row()])
    with Journal(folder / records.EVALUATIONS) as journal:
        for checkpoint in (0, 64) if evaluations else ():
            for deterministic in (False, True):
                counters = {"episode": 0, "eval_episode": 0, "step": checkpoint, "checkpoint": checkpoint}
                mode = {"deterministic": deterministic, "actions": ()}
                row = Evaluation(return_=-20.0 + deterministic, **counters, **mode, poses=POSES, **REST)
                journal.append([row.as_row()])
    return folder


@pytest.mark.parametrize("episodes", [True, False])
def test_learning_curve_is_a_picture_and_the_same_bytes_again(tmp_path, episodes):
    path = learning_curve.write(trial(tmp_path, episodes=episodes))
    first = path.read_bytes()
    with Image.open(path) as image:
        assert image.format == "PNG" and image.width >= 1000
        assert len(image.convert("L").getcolors()) > 3
    assert learning_curve.write(path.parent).read_bytes() == first


def test_what_is_drawn_is_what_was_recorded(tmp_path):
    axes = learning_curve.draw(records.Trial.read(trial(tmp_path))).axes[0]
    drawn = {line.get_label().partition(" (")[0]: [float(y) for y in line.get_ydata()] for line in axes.lines}
    assert drawn == {
        "training, mean of 40 episodes": [-20.0, -19.5, -19.0, -18.5],
        "evaluation, sampled actions": [-20.0, -20.0],
        "evaluation, greedy actions": [-19.0, -19.0],
        "optimum": [-5.0, -5.0],
        "random agent": [-21.0, -21.0],
    }


@pytest.mark.parametrize("explores", [True, False])
def test_sampled_actions_that_are_exploration_have_no_curve(tmp_path, explores):
    (legend,) = learning_curve.draw(records.Trial.read(trial(tmp_path, explores=explores))).legends
    told = " ".join(text.get_text() for text in legend.get_texts())
    assert "greedy" in told and ("sampled" in told) != explores


def test_trial_without_evaluations_is_refused(tmp_path):
    with pytest.raises(ValueError, match="no evaluations"):
        learning_curve.write(trial(tmp_path, evaluations=False))
