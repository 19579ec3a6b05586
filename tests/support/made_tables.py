"""Results made by hand: a trial is a few words, its curves follow from its final score."""

import pandas as pd

from usbench.results.tables import CURVE_COLUMNS, GREEDY, SAMPLED, TRAINING, TRIAL_COLUMNS, Results

STEPS = 16_064
FIXED = ("random", "stay", "oracle")


def trial(algo="vpg", score=0.5, *, task="fp", noise=0.0, seed=100, **changes):
    """Return the row of a trial, with its final score beside the columns."""
    row = {
        "trial": f"{task}-p{noise:g}-{algo}-s{seed}",
        "task": task,
        "noise": noise,
        "algo": algo,
        "seed": seed,
        "steps": 0 if algo in FIXED else STEPS,
        "configuration": "00000001",
        "status": "finished",
        "reason": "",
        "settings": '{"environment": "e", "gamma": 0.99}',
        "optimal": -5.0,
        "random": -21.0,
        "stay": -22.6,
        "training_s": 120.0,
        "total_s": 180.0,
        "versions": "numpy 2.0, torch 2.5",
        "frames": "abc",
        "score": score,
    }
    return row | changes


def curve(kind, name, step, score):
    """Return a row of the curves: everything follows from the score."""
    means = {
        "return": -21 + 16 * score,
        "normalized_score": score,
        "final_distance_mm": 10 * (1 - score),
        "abs_sin_angle": 0.5,
        "plane_error_deg": 30.0,
        "success_rate": 0.25,
        "reached_rate": 0.5,
        "steps_to_goal": 12.0,
    }
    return {"trial": name, "kind": kind, "step": step, "trained": step, "episodes": 20} | means


def curves(row):
    """Return the curves of a trial: from 0 through half its score to its score; sampled actions lose 0.1."""
    name, steps, score = row["trial"], row["steps"], row["score"]
    shares = (0, 0.5, 1) if steps else (1,)
    return [
        *(curve(SAMPLED, name, int(steps * share), score * share - 0.1) for share in shares),
        *(curve(GREEDY, name, int(steps * share), score * share) for share in shares),
        *(curve(TRAINING, name, steps * part // 50, score * part / 50) for part in range(1, 51) if steps),
    ]


def made(*trials):
    """Return the results of trials; those that are not finished have no curves."""
    rows = [row for known in trials if known["status"] == "finished" for row in curves(known)]
    return Results(
        pd.DataFrame(trials, columns=list(TRIAL_COLUMNS)), pd.DataFrame(rows, columns=list(CURVE_COLUMNS))
    )


def seeds(algo, scores, **changes):
    """Return one trial for each score, with the first seeds that are kept for comparisons."""
    return [trial(algo, score, seed=seed, **changes) for seed, score in enumerate(scores, 100)]
