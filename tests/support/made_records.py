"""Folders of trials as training writes them, with numbers that one works out by hand."""

import dataclasses

from state_files import write_state

from usbench import records
from usbench.records import Episode, Evaluation, TrialConfig
from usbench.records.journal import Journal

ANCHORS = {"optimal": -4.0, "random": -20.0, "stay": -22.0}
STEPS = 100
POSES = {f"{when}_{key}": 0 for when in ("start", "final") for key in ("x_mm", "focal_depth_mm", "angle_deg")}


def config(seed=0, **changes):
    values = {"task": "pp", "algo": "vpg", "noise": 0.25, "seed": seed, "steps": STEPS}
    return TrialConfig(**{**values, "hyperparameters": {"gamma": 0.9}, **changes})


def facts(return_, distance=5.0, sine=0.5, success=False, to_goal=None):
    return {
        "return_": return_,
        "final_distance_mm": distance,
        "final_sin_angle": sine,
        "is_success": success,
        "steps_to_goal": to_goal,
        "poses": POSES,
    }


def write_trial(out, config, status="finished", last=STEPS, **state):
    """Two evaluation episodes of each kind at two checkpoints, and three training episodes."""
    folder = records.create(out, config)
    known = {
        "status": status,
        "reason": None,
        "config": dataclasses.asdict(config),
        "anchors": ANCHORS,
        "timings": {},
        "versions": {},
    } | state
    write_state(folder, known)
    with Journal(folder / records.EPISODES) as journal:
        for number, (step, return_) in enumerate([(1, -20.0), (2, -12.0), (100, -4.0)]):
            journal.append([Episode(episode=number, step=step, **facts(return_)).as_row()])
    with Journal(folder / records.EVALUATIONS) as journal:
        for checkpoint in (0, last):
            for deterministic in (False, True):
                for number, fact in enumerate(
                    [facts(-4.0, 0.0, -1.0, True, 3), facts(-12.0 - 8 * deterministic)]
                ):
                    counters = {"episode": number, "eval_episode": number, "step": checkpoint}
                    mode = {"deterministic": deterministic, "actions": (0,) * 16, "checkpoint": checkpoint}
                    journal.append([Evaluation(**counters, **mode, **fact).as_row()])
    return folder
